"""Contact detection in dynamic runs: the list of near pairs, and the transition from joints to contacts.

A joint stays in use as long as its polygon describes how its blocks touch. Once one face has turned far relative to the
other, or the blocks have parted and moved away, a new contact of that pair of parts replaces it for good. Pairs
without a joint are tracked once they come within a margin of each other. Pairs are updated between two chunks
of steps, before anything can have moved by the margin; a scene in which nothing comes near has no cost.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field

import numpy as np

from dembrick.assembly.broad_phase import Bodies, bodies_of, close_pairs, overlap_depths
from dembrick.assembly.build import Assembly
from dembrick.assembly.joints import TOLERANCE, Joint, JointTable
from dembrick.errors import HistoryError
from dembrick.geometry.shapes import parts_of
from dembrick.kernels.dynamics.contact_forces import PARTED, SINK, SLIP, TURN, Touching
from dembrick.kernels.dynamics.contact_surface import Parts, Scratch
from dembrick.simulation.dynamics.contact_state import parts_table, scratch_for, touching_pairs
from dembrick.simulation.dynamics.joint_polygons import Polygons
from dembrick.simulation.dynamics.state import MovingState
from dembrick.simulation.dynamics.time_step import load_of_contacts
from dembrick.simulation.session import Snapshot

MARGIN = 0.03  # of a part's diameter: parts that are nearer than the sum of theirs are tracked
FIRST = 5e-4  # of the smallest block's diameter: displacement before the first detection
STIRRED = 0.3  # of the motion at which the handover of a joint begins: beyond it joints are tracked
GONE = 0.05  # of its size: an open joint whose nearest corner is so far apart will not be handed back,
TIPPED = 0.02  # of its size: nor one that has turned or slipped far, if a corner is so far before or behind the face
LOOSE = 1e-3  # of its size: a joint that has moved so far is tracked too, if any pair is
# Edges that lie along each other at the start overlap as the joints beside them yield. They exert no force until it
# would be that part of the lighter block's weight, or their depth that part of the thinner one's radius
NEGLIGIBLE, SHALLOW = 1e-3, 1e-2
SLIVER = 1e-5  # of that radius: a depth that is neglected
STABLE = 4.0  # stability limit of the greatest eigenvalue of M^-1 (dt^2 K + 2 dt C), with springs K and dashpots C
MOST = 8.0  # cap, twice the stability limit, on the bound beyond which a block is examined again
# fields of a pair that are kept when pairs are updated
REMEMBERED = ("weight", "slack", "plane", "elastic", "stiffness", "twist", "slip", "normal", "area", "point", "axis",
              "force", "torque")  # fmt: skip

PAIRS = ("first", "second", "joint")
# recorded fields of a contact that carries a force: type and shape
NEW_CONTACT = {"blocks": (np.int64, (2,)), "point": (float, (3,)), "normal": (float, (3,)), "force": (float, (3,)),
               "torque": (float, (3,)), "area": (float, ()), "slip": (float, ())}  # fmt: skip
_NO_CONTACTS = {name: np.zeros((0, *tail), kind) for name, (kind, tail) in NEW_CONTACT.items()}


@dataclass
class ContactDetection:
    """New contacts of a run, and the schedule of their detection; ``touching`` is None while nothing comes near.

    ``retired`` (j,): joints that new contacts have replaced; ``looked`` (n, 4, 3): centroids and body axes at the last
    update of pairs; ``patience`` (m): displacement of blocks until the next one; ``bearable``: bound of the stability
    number of a block's contacts, in addition to its joints, beyond which `examine` computes it; ``met``: blocks that
    overlapped at the first detection although they were not drawn so, as they had come to rest in each other.
    """

    assembly: Assembly
    ratio: float
    bearable: float = STABLE
    touching: Touching | None = None
    looked: np.ndarray | None = None
    patience: float = 0.0
    retired: np.ndarray = field(init=False)

    def __post_init__(self):
        shapes = self.assembly.shapes
        self._joints = JointTable.of(self.assembly.joints)
        self.retired = np.zeros(len(self._joints), bool)
        self._size = min(part.diameter for shape in shapes for _, part in parts_of(shape))
        self._parts = self._scratch = None
        self._codes = None
        self._free = np.where(self.assembly.fixed, 0.0, 1.0)
        self._bears = np.zeros(len(self._free))  # bounds above `bearable` that `examine` has allowed
        self.struck = np.zeros(len(self._joints), bool)  # joints whose blocks hit each other as the run begins
        self.met: list[tuple[int, int]] = []
        self._quiet = 0.0  # m, displacement of any block before `follow` must check anything else,
        self._far_turned = np.zeros(0, np.int64)  # and joints that are to be retired once they are open
        self._partial = np.array([self._is_partial(joint) for joint in self._joints], bool)

    def _is_partial(self, joint: Joint) -> bool:
        """Whether the polygon of a joint is smaller than the face to which it is fixed."""
        on_a = joint.host == joint.block_a
        block, part = (joint.block_a, joint.part_a) if on_a else (joint.block_b, joint.part_b)
        _, shape = parts_of(self.assembly.shapes[block])[part]
        outward = self.assembly.rotation[block].T @ joint.axes[2] * (1.0 if on_a else -1.0)
        return joint.area < (1.0 - 1e-6) * shape.face_areas[int(np.argmax(shape.face_normals @ outward))]

    def strike(self, polygons: Polygons, joints: np.ndarray) -> None:
        """Replace ``joints`` (j,) whose blocks hit each other as time begins by new contacts, as for an impact."""
        self.struck |= joints
        for j in np.flatnonzero(joints).tolist():
            polygons.retire(j)
        self.retired |= joints

    def let_move(self, supports: np.ndarray) -> None:
        """Treat moving supports (k,) as blocks that may come near others."""
        self._free[supports] = 1.0

    def forget(self) -> None:
        """Reset the detection after blocks have been put elsewhere."""
        self.touching, self.looked, self.met = None, None, []

    def steps_to_go(self, state: MovingState, gravity: float, dt: float, fastest: float = 0.0) -> float:
        """Estimated number of steps, at the speed of the blocks or ``fastest`` (m/s), until pairs must be updated;
        infinite if there are contacts, as the loop itself then tracks the motion."""
        if self.touching is not None:
            return np.inf
        bodies = state.bodies
        speed = np.sqrt((bodies.velocity**2).sum(axis=1)) + bodies.reach * np.sqrt((bodies.spin**2).sum(axis=1))
        fastest, far = max(fastest, float(speed.max())), 0.5 * self.patience
        return max(1.0, 2.0 * far / (fastest + np.sqrt(fastest**2 + 2.0 * gravity * far) + 1e-300) / dt)

    @property
    def room(self) -> float:
        """Displacement (m) of any block until pairs must be updated; infinite if there are contacts, which track it."""
        return 0.5 * self.patience if self.touching is None else np.inf

    def calm_for(self, steps: int, gravity: float, dt: float) -> tuple[float, float]:
        """The speed (m/s) of a point up to which `steps_to_go` is at least ``steps``, and the displacement (m) of a
        block from which `follow` has work to do."""
        if self.touching is not None:
            return np.inf, np.inf
        far = 0.5 * self.patience
        mean = far / (steps * dt)
        return (1.0 - 1e-6) * (mean - 0.5 * gravity * steps * dt), -1.0 if len(self._far_turned) else self._quiet

    def follow(self, state: MovingState, polygons: Polygons, called: bool, travel: np.ndarray) -> None:
        """Update the pairs if that is due: because the loop ``called`` for it, or blocks or joints have moved.

        ``travel`` (1,): bound (m) of the displacement of any block since this last set it to zero.
        """
        if not called and (self.touching is not None or (travel[0] < self._quiet and not self._lifted(state))):
            return
        self._quiet = travel[0] = 0.0
        here = np.concatenate([state.bodies.position[:, None], state.bodies.rotation.transpose(0, 2, 1)], axis=1)
        first = self.looked is None
        if not (first or called):
            away = here - self.looked
            moved = np.sqrt((away[:, 0] ** 2).sum(axis=1))
            moved += state.bodies.reach * np.sqrt((away[:, 1:] ** 2).sum(axis=(1, 2)))
            turn, slip = self._turn(state), polygons.slipped()
            if moved.max() < 0.5 * self.patience and not self._stirred(state, polygons, turn, slip).any():
                self._quiet = self._patient(state, polygons, turn, slip, float(moved.max()))
                return
        self.looked = here
        self._look(state, polygons, first)

    def examine(self, state: MovingState, dt: float) -> int | None:
        """Compute the stability number of the contacts of the last step for a step of ``dt``: return the block whose
        contacts are too stiff for it, or None. Otherwise raise the bounds of overloaded blocks by half of the margin
        left."""
        touching = self.touching
        worst = int(np.argmax(touching.load - touching.bearable))
        swing = load_of_contacts(state, touching, self.left_to_joints(), dt)
        if swing >= STABLE:
            return worst
        over = touching.load > touching.bearable
        more = np.minimum(touching.load * min(2.0, 0.5 * (1.0 + STABLE / swing)), MOST)
        self._bears[over] = np.maximum(more, 1.1 * touching.load)[over]
        touching.bearable[:] = np.maximum(self._bears, self.bearable)
        touching.overloaded[0] = 0
        return None

    def pressed(self, middle: np.ndarray) -> dict[str, np.ndarray]:
        """The k new contacts that carried a force in the last evaluation.

        ``blocks`` (k, 2); ``point`` (k, 3) m, the centre of pressure in the world, if positions are measured from
        ``middle``; ``normal`` (k, 3), from the first block to the second; ``force`` (k, 3) N on the second
        and ``torque`` (k, 3) N m on it about the point; ``area`` (k,) m2; ``slip`` (k,) m, the length of its path.
        """
        touching = self.touching
        if touching is None:
            return dict(_NO_CONTACTS)
        on = touching.normal > 0.0
        return {
            "blocks": touching.parts.owner[np.column_stack([touching.first, touching.second])[on]],
            "point": touching.point[on] + middle,
            "normal": touching.axis[on],
            "force": touching.force[on],
            "torque": touching.torque[on],
            "area": touching.area[on],
            "slip": touching.slip[on],
        }

    @property
    def carrying(self) -> int:
        """Number of new contacts that carry a force now."""
        return 0 if self.touching is None else int(np.count_nonzero(self.touching.normal > 0.0))

    def left_to_joints(self) -> np.ndarray:
        """Share (j,) of its force that each joint still carries; the contact that replaces it carries the rest."""
        share = np.where(self.retired, 0.0, 1.0)
        if self.touching is not None:
            handed = self.touching.joint >= 0
            share[self.touching.joint[handed]] = 1.0 - self.touching.weight[handed]
        return share

    def _stirred(self, state: MovingState, polygons: Polygons, turn: np.ndarray, slip: np.ndarray) -> np.ndarray:
        """Joints (j,) that will be handed over soon, by their ``turn`` and ``slip`` (j,), or have parted."""
        size = polygons.size
        due = (turn > STIRRED * TURN[0]) | (
            self._partial & ((slip > STIRRED * SLIP[0] * size) | (slip * turn > STIRRED * SINK[0] * size))
        )
        return ~self.retired & (due | self._parted(state, polygons))

    def _lifted(self, state: MovingState) -> bool:
        """Whether any of the joints that are to be retired once open has no force."""
        return len(self._far_turned) > 0 and not state.links.wrench[self._far_turned, :3].any(axis=1).all()

    def _patient(self, state: MovingState, polygons: Polygons, turn, slip, moved: float) -> float:
        """Distance (m) that any block may still move before the list of near pairs can be out of date.

        Also notes the joints that are to be retired once open. While no block moves by more than s, the turn between
        two grows by at most s (1/R + 1/R') with their reaches R, and a point of the one, at d from the other's
        centroid, moves past that by at most s (2 + d/R'); less if one is fixed.
        """
        far = (0.5 * self.patience - moved) / np.sqrt(2.0)
        if len(self._joints):
            links, size, reach = state.links, polygons.size, state.bodies.reach
            host, other = self._free[links.host], self._free[links.other]
            away = np.sqrt((links.seen[:, :3] ** 2).sum(axis=1))
            turning = np.maximum(host / reach[links.host] + other / reach[links.other], 1e-300)
            passing = 0.1 + host + other * (1.0 + away / reach[links.other])
            slipping = passing + turning * (np.abs(polygons.shift).sum(axis=1) + 2.0 * size)
            gap = links.sense * (links.field("origin")[:, 2] - links.offset)
            parting = PARTED * size - gap + size * turn
            self._far_turned = np.flatnonzero((parting < 0.0) & ~self.retired)
            parting = np.where(parting < 0.0, np.inf, parting)
            rooms = [(STIRRED * TURN[0] - turn) / turning, parting / (passing + size * turning)]
            a, b = slipping * turning, slip * turning + turn * slipping
            c = STIRRED * SINK[0] * size - slip * turn
            sinking = 2.0 * c / (b + np.sqrt(b * b + 4.0 * a * c))
            slid = np.minimum((STIRRED * SLIP[0] * size - slip) / slipping, sinking)
            rooms.append(np.where(self._partial, slid, np.inf))
            far = min(far, float(np.where(self.retired, np.inf, np.min(rooms, axis=0)).min()))
        return 0.99 * max(0.0, far)

    def _turn(self, state: MovingState) -> np.ndarray:
        seen = state.links.seen
        return np.hypot(seen[:, 5], seen[:, 8])

    def _parted(self, state: MovingState, polygons: Polygons) -> np.ndarray:
        """Joints (j,) that are open with all corners apart."""
        return self._apart(state, polygons) > PARTED * polygons.size

    def _apart(self, state: MovingState, polygons: Polygons) -> np.ndarray:
        """Lower bound (m) of the least distance of the faces of each joint (j,); zero if it is closed."""
        links = state.links
        is_open = (links.wrench[:, :3] == 0.0).all(axis=1)
        gap = links.sense * (links.field("origin")[:, 2] - links.offset)
        return np.where(is_open, np.maximum(gap - polygons.size * self._turn(state), 0.0), 0.0)

    def _gone(self, state: MovingState, polygons: Polygons) -> np.ndarray:
        """Joints (j,) that are open and so far apart, turned or slipped that they will not be handed back."""
        links, size = state.links, polygons.size
        is_open = (links.wrench[:, :3] == 0.0).all(axis=1)
        gap, tilt = links.sense * (links.field("origin")[:, 2] - links.offset), size * self._turn(state)
        # an open joint below the face has slid over its edge, and would come back as if from within the block
        beside = np.maximum(gap + tilt, tilt - gap) > TIPPED * size
        tipped = self._strayed(state, polygons) & beside
        return is_open & (tipped | (self._apart(state, polygons) > GONE * size))

    def _strayed(self, state: MovingState, polygons: Polygons) -> np.ndarray:
        """Joints (j,) that have turned or slipped so far that they are being handed over."""
        size, turn, slip = polygons.size, self._turn(state), polygons.slipped()
        return (turn > TURN[0]) | (self._partial & ((slip > SLIP[0] * size) | (slip * turn > SINK[0] * size)))

    def _look(self, state: MovingState, polygons: Polygons, first: bool) -> None:
        assembly, bodies = self.assembly, state.bodies
        parts = self._start.moved(bodies.position, bodies.rotation)
        pairs = close_pairs(parts, MARGIN)
        ends = parts.owner[pairs]
        free = ~assembly.fixed
        pairs = pairs[(ends[:, 0] != ends[:, 1]) & free[ends].any(axis=1)]
        depth = overlap_depths(parts, pairs)
        near = depth > -MARGIN * parts.table.diameter[pairs].sum(axis=1)
        pairs, depth = pairs[near], depth[near]
        joint = self._joint_of(parts.owner, pairs)
        self._retire(state, polygons, joint, depth)
        watched = np.zeros(len(self._joints) + 1, bool)  # the last for pairs without a joint
        watched[-1] = True
        stirred = self._stirred(state, polygons, self._turn(state), polygons.slipped())
        if self.touching is not None:
            stirred[self.touching.joint[(self.touching.joint >= 0) & (self.touching.weight > 0.0)]] = True
        struck = np.append(self.struck, False)[joint]
        joint = np.where(np.append(self.retired, False)[joint], -1, joint)
        if (joint < 0).any() or stirred.any():
            watched[:-1] = stirred | (polygons.moved() > LOOSE * polygons.size)
        wanted = watched[joint]
        pairs, depth, joint, struck = pairs[wanted], depth[wanted], joint[wanted], struck[wanted]
        if first and len(pairs):
            # parts that touch at the start are tracked once something moves; parts that are apart, by however little,
            # are found again before they can have met
            self.patience = max(2.0 * FIRST * self._size, float(np.maximum(-depth, 0.0).min()))
            apart = -depth > TOLERANCE * parts.table.diameter[pairs].min(axis=1)
            self.patience = min(self.patience, 0.49 * float(-depth[apart].max(initial=-np.inf)))
            # a thrown block may reach another one within a step
            met = (depth > 0.0) & (joint < 0) & ~self._lie(parts.owner, pairs)
            self.met = [(int(a), int(b)) for a, b in parts.owner[pairs[met]]]
            struck = struck | met
            thrown = struck | (apart & bool(bodies.velocity.any()))
            if not thrown.any():
                return
            pairs, depth, joint, struck = pairs[thrown], depth[thrown], joint[thrown], struck[thrown]
        else:
            self.patience = MARGIN * self._size
        self._watch(state, polygons, parts.owner, pairs, np.where(struck, -np.inf, depth), joint)

    def _joint_of(self, owner: np.ndarray, pairs: np.ndarray) -> np.ndarray:
        """The joint of each pair of parts (p,), or -1."""
        joints, count = self._joints, len(owner)
        if not len(joints):
            return np.full(len(pairs), -1)
        if self._codes is None:
            first = np.searchsorted(owner, np.arange(len(self.assembly.shapes)))
            a, b = first[joints.block_a] + joints.part_a, first[joints.block_b] + joints.part_b
            codes = np.minimum(a, b) * count + np.maximum(a, b)
            order = np.argsort(codes)
            self._codes = codes[order], order
        codes, order = self._codes
        wanted = pairs[:, 0] * count + pairs[:, 1]
        place = np.minimum(np.searchsorted(codes, wanted), len(codes) - 1)
        return np.where(codes[place] == wanted, order[place], -1)

    def _retire(self, state: MovingState, polygons: Polygons, joint: np.ndarray, depth: np.ndarray) -> None:
        """Retire joints that a contact has fully replaced, or whose blocks have parted and lie far apart, for good."""
        due = self._gone(state, polygons)
        due[joint[(joint >= 0) & (depth > 0.0)]] = False
        if self.touching is not None:
            taken = self.touching.joint[(self.touching.joint >= 0) & (self.touching.weight >= 1.0)]
            due[taken] |= self._strayed(state, polygons)[taken]
        for j in np.flatnonzero(due & ~self.retired).tolist():
            polygons.retire(j)
        self.retired |= due

    def _watch(self, state: MovingState, polygons: Polygons, owner, pairs, depth, joint) -> None:
        """Set `touching` to these pairs; pairs that were tracked before keep their history.

        ``depth`` (p,): overlap (m) of the parts. Parts that overlap already have been side by side since the start: if
        they have no joint, the weight of their contact begins at zero, and later (`_let_lie`).
        """
        before, laws = self.touching, self.assembly.laws
        if not len(pairs):
            self.touching = None
            return
        of_pairs = [laws.between(a, b) for a, b in owner[pairs].tolist()]
        fresh = self._blank(polygons, pairs, joint, of_pairs)
        fresh.weight[(depth > 0.0) & (joint < 0)] = 0.0
        self._let_lie(fresh)
        if before is not None:
            count = len(owner)
            new, old = fresh.first * count + fresh.second, before.first * count + before.second
            _, here, there = np.intersect1d(new, old, assume_unique=True, return_indices=True)
            for name in REMEMBERED:
                getattr(fresh, name)[here] = getattr(before, name)[there]
        fresh.room[0] = self.patience
        fresh.bearable[:] = np.maximum(self._bears, self.bearable)
        self.touching = fresh

    def blank(self, polygons: Polygons) -> Touching:
        """`touching` without pairs, sized for the block with the fewest faces: small arrays of the same types."""
        simplest = min(self.assembly.shapes, key=lambda shape: max(len(part.faces) for _, part in parts_of(shape)))
        parts = parts_table([simplest])
        return self._blank(polygons, np.zeros((0, 2)), np.zeros(0), [], (parts, scratch_for(parts)))

    @functools.cached_property
    def _start(self) -> Bodies:
        """The convex parts of all blocks at their initial positions."""
        return bodies_of(self.assembly.shapes, self.assembly.position, self.assembly.rotation)

    @functools.cached_property
    def _lying(self) -> np.ndarray:
        """Pairs of parts (k,) that touch at the start, encoded as first * (number of parts) + second."""
        start = self._start
        pairs = close_pairs(start, TOLERANCE)
        pairs = pairs[start.owner[pairs[:, 0]] != start.owner[pairs[:, 1]]]
        pairs = pairs[overlap_depths(start, pairs) > -TOLERANCE * start.table.diameter[pairs].min(axis=1)]
        return pairs[:, 0] * len(start.owner) + pairs[:, 1]

    def _lie(self, owner: np.ndarray, pairs: np.ndarray) -> np.ndarray:
        """Whether each pair of parts (p,) touches at the start."""
        return np.isin(pairs[:, 0] * len(owner) + pairs[:, 1], self._lying)

    def _let_lie(self, touching: Touching) -> None:
        """Suppress the forces of parts without a joint whose edges touch at the start until they are significant."""
        assembly, owner = self.assembly, touching.parts.owner
        pairs = np.column_stack([touching.first, touching.second])
        near = np.flatnonzero(self._lie(owner, pairs) & (touching.joint < 0))
        pairs = pairs[near]
        weight = np.where(assembly.fixed, np.inf, np.linalg.norm(assembly.gravity) * assembly.mass)[owner[pairs]]
        radius = touching.parts.inner[pairs].min(axis=1)
        touching.least[near] = NEGLIGIBLE * weight.min(axis=1)
        touching.deepest[near] = SHALLOW * radius
        touching.slack[near] = SLIVER * radius

    def _blank(self, polygons: Polygons, pairs, joint, laws, room: tuple[Parts, Scratch] | None = None) -> Touching:
        if room is None and self._parts is None:
            self._parts = parts_table(self.assembly.shapes)
            self._scratch = scratch_for(self._parts)
        parts, scratch = room or (self._parts, self._scratch)
        known = (polygons.size, self._partial, polygons.start, polygons.shift) if len(self._joints) else None
        return touching_pairs(parts, scratch, ~self.assembly.fixed, pairs, joint, laws, self.ratio, known)

    def snapshot(self) -> dict[str, np.ndarray]:
        """Arrays for a restart, in addition to the state of the run."""
        count = -1.0 if self.touching is None else float(len(self.touching.first))
        arrays = {
            "contacts.loop": np.array([self.patience, count]),
            "contacts.retired": self.retired,
            "contacts.looked": self.looked,
        }
        for name in (*PAIRS, *REMEMBERED, "room") if self.touching is not None else ():
            arrays[f"contacts.{name}"] = getattr(self.touching, name)
        return arrays

    def restore(self, state: MovingState, polygons: Polygons, snapshot: Snapshot) -> None:
        """Restore it from a snapshot of the same scene; HistoryError if it is of another."""
        self.patience, count = snapshot.array("contacts.loop", np.zeros(2)).tolist()
        self.retired[:] = snapshot.array("contacts.retired", self.retired)
        self.looked = snapshot.array("contacts.looked", np.zeros((len(state.bodies.mass), 4, 3))).copy()
        self.touching = None
        if count == -1.0:
            return
        parts, joints = parts_table(self.assembly.shapes), len(self.retired)
        most = len(parts.owner) ** 2
        if not (0.0 < count <= most and count.is_integer()):
            raise HistoryError(f"{snapshot.path}: contacts.loop does not belong to this scenario")
        first, second, joint = (
            snapshot.array(f"contacts.{name}", np.zeros(int(count), np.int64)).copy() for name in PAIRS
        )
        pairs = np.column_stack([first, second])
        if (pairs < 0).any() or (pairs >= len(parts.owner)).any() or (joint < -1).any() or (joint >= joints).any():
            raise HistoryError(f"{snapshot.path}: the pairs of contacts do not belong to this scenario")
        laws = [self.assembly.laws.between(a, b) for a, b in parts.owner[pairs].tolist()]
        self.touching = self._blank(polygons, pairs, joint, laws)
        self._let_lie(self.touching)
        for name in (*REMEMBERED, "room"):
            own = getattr(self.touching, name)
            own[...] = snapshot.array(f"contacts.{name}", own)
        self.touching.bearable[:] = self.bearable
        faces = parts.face_count[pairs].sum(axis=1)
        if (self.touching.plane < -1).any() or (self.touching.plane >= faces).any():
            raise HistoryError(f"{snapshot.path}: contacts.plane is outside the range of its faces")
