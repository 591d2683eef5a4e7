"""A lone joint in the kernels of either engine: contact points or a convex joint, driven by the motion of a step."""

import numpy as np

from dembrick.geometry import friction_integrals, polygons
from dembrick.kernels.dynamics import area_joints as moving_areas
from dembrick.kernels.dynamics import area_tiles, point_laws, slip_paths, tiles
from dembrick.kernels.dynamics import point_joints as moving_points
from dembrick.kernels.dynamics.energy_terms import LEDGER, LOST, PRESSURE, TOTAL, Counted, EnergyTerms
from dembrick.kernels.joint.geometry import Motion
from dembrick.kernels.joint.point_law import Strengths
from dembrick.kernels.state import WORK, Energy
from dembrick.kernels.statics import area_joints, point_joints
from dembrick.simulation.joint_laws import pressed_parts

W = tiles.W
K_N, K_S, MU, VISCOUS = 1e8, 5e7, 0.5, 0.3
OUTLINE = np.array([[-0.15, -0.10], [0.15, -0.10], [0.15, 0.10], [-0.15, 0.10]])
FIVE_CORNERS = np.insert(OUTLINE, 2, (0.15, 0.03), axis=0)  # the same polygon with a redundant corner
CARRIED = tiles.record(("pressing", 3), ("shearing", 3))  # in double precision
AREAS = np.array([0.010, 0.015, 0.020, 0.015])  # of the points, at the corners


def one(kind):
    """A record of that kind, all zero."""
    return tiles.rows_of_lanes(1, kind)[0]


def motion_of(opening, opened, slip):
    """The `Motion` of an opening at O with tilts (dn, r1, r2), its growth in a step, and a slip twist."""
    depth, growth = ((-float(dn), float(r2), -float(r1)) for dn, r1, r2 in (opening, opened))
    return Motion(depth, growth, tuple(float(s) for s in slip))


def strengths_of(law):
    """`Strengths` of one joint: those in a law, otherwise a dry joint."""
    dry = {"cohesion": 0.0, "tension": 0.0, "crushing": np.inf, "dilation": 0.0, "residual_cohesion": 0.0}
    values = dry | {"residual": 1.0} | law
    return Strengths(**{name: np.array([value]) for name, value in values.items()}, held=np.zeros(1))


def bond_of(law, count):
    """The initial bond (count,): 1 if the law has a strength that can be lost."""
    return np.full(count, float(any(name in law for name in ("cohesion", "tension", "residual"))))


def energy_of(points):
    """Zeroed energy terms of one joint in the searches."""
    normal = np.zeros((0, 7))
    if points is not None:
        k, x, y = points.k_n, points.x_n, points.y_n
        normal = np.array([[*((k * f).sum() for f in (1.0, x, y, x * x, y * y, x * y)), np.hypot(x, y).max()]])
    return Energy(np.zeros(1, WORK), np.zeros(0, np.int64), np.zeros((2, 6)), normal)


def taken(energy):
    """Dissipation by friction, by the law, in dashpots and released springs, by crushing and by fracture (J)."""
    return np.array([energy.work[name][0] for name in ("sliding", "by_law", "damping", "crushing", "fracture")])


class LoneJoint:
    """Views of a ``joint`` and its ``energy``; ``memory`` is that of a convex joint, one elastic force."""

    @property
    def memory(self):
        return self.joint.elastic[0]

    @property
    def slip(self):
        return self.joint.slip

    @property
    def dissipated(self):
        """By friction, by the law of friction, in dashpots and released springs, by crushing and by fracture of bonds
        (J)."""
        return taken(self.energy)


class StaticPoints(LoneJoint):
    """A joint of four points in the searches."""

    def __init__(self, mu=MU, law=None):
        x, y = np.ascontiguousarray(OUTLINE.T)
        zero = [np.zeros(4) for _ in range(4)]
        bonds = (None, None)
        if law is not None:
            bonds = strengths_of(law), point_joints.Bonds(AREAS.copy(), bond_of(law, 4), *np.zeros((3, 4)))
        self.joint = point_joints.Points(
            np.zeros(1, np.int64), np.array([0, 4]), np.array([mu]), x, y, x, y, K_N * AREAS, K_S * AREAS, *zero,
            np.zeros(1), *bonds,
        )  # fmt: skip
        self.energy, self.before = energy_of(self.joint), np.zeros(7)

    def step(self, motion, change, twist):
        seen = motion_of(np.add(motion, change), change, twist)
        self.before[:] = point_joints.forces(self.joint, 0, self.before.copy(), seen, (VISCOUS, VISCOUS), self.energy)
        return self.before[:6].copy()

    @property
    def memory(self):
        return np.stack([self.joint.elastic_1, self.joint.elastic_2], axis=1)

    @property
    def slip(self):
        return self.joint.path

    @property
    def bonds(self):
        """For every point: whether its bond is intact, its crushed depth, its rise."""
        return np.stack(self.joint.bonds[1:4], axis=1)


class MovingPoints:
    """The same joint in every lane of a tile; its host is on the side of b."""

    def __init__(self, mu=MU, law=None):
        self.mu = mu
        self.strengths = None if law is None else strengths_of(law)
        self.of_bonds = None if law is None else np.zeros(4, point_laws.BOND)
        if law is not None:
            self.of_bonds["bonded"] = bond_of(law, 4)[:, None]
        self.custom = None  # `Custom` of a user's law
        self.tile, self.work = one(tiles.FIXED), one(tiles.WORK)
        self.tile.viscous[:] = VISCOUS
        self.own = np.zeros(4, tiles.POINT)
        self.own["x"], self.own["y"] = OUTLINE[:, 0, None], OUTLINE[:, 1, None]
        self.own["area"] = AREAS[:, None]
        self.sheared, self.path = np.zeros(4, tiles.SHEAR), np.zeros(W)
        self.seen = seen_flat()
        self.dashpots, self.ledger = one(CARRIED), one(LEDGER)

    def step(self, motion, change, twist):
        place(self.work, motion, change, twist)
        moving_points.clear_sums(self.tile, self.work)
        law = moving_points.PointLaw(K_N, K_S, self.mu, 1.0)
        for pair in range(2):
            two = slice(2 * pair, 2 * pair + 2)
            points = self.own[two], self.sheared[two]
            bonded = custom = None
            if self.strengths is not None:
                bonded = point_laws.BondedPair(self.strengths, 0, self.of_bonds[two])
            if self.custom is not None:
                custom = self.rows_of(2 * pair)
            if moving_points.pair_forces(self.work, points, law, True, None, bonded, custom, self.ledger):
                slip_paths.add_slip(self.work)
                if bonded is None and custom is None:
                    moving_points.add_losses(self.work, points, law, self.ledger)
        dry = self.strengths is None and self.custom is None
        slip_paths.lengthen_paths(self.work, dry, np.arange(W, dtype=np.uint32), self.path)
        moving_points.add_dashpot_work(self.work, self.seen, self.dashpots, self.ledger)
        # the force acts on the host at (1, x, y); the slip of the host is that of b
        f, fx, fy = (rows[:, 3] for rows in (self.work.force, self.work.x_force, self.work.y_force))
        return np.array([f[2], -f[0], -f[1], -(fx[1] - fy[0]), -fy[2], fx[2]])

    def rows_of(self, point):
        """`Custom` of two points, the first with number ``point``."""
        names = ("move", "record", "memory", "answer", "since", "tried")
        return self.custom._replace(**{name: getattr(self.custom, name)[point * W : (point + 2) * W] for name in names})

    @property
    def memory(self):
        return self.sheared["elastic"][..., 3]

    @property
    def slip(self):
        return self.path[3:4]

    @property
    def dissipated(self):
        return lost_of(self.ledger, 3)

    @property
    def bonds(self):
        return np.stack([self.of_bonds[name][:, 3] for name in point_laws.BOND.names], axis=1)


def seen_flat():
    """The `SEEN` of hosts whose polygons lie in the plane, with axes along its axes."""
    seen = one(tiles.SEEN)
    seen.first[0] = seen.second[1] = 1.0
    return seen


def lost_of(ledger, lane):
    """Dissipation of the joint in a lane: friction, law, dashpots with released springs, crushing, fracture (J)."""
    names = ("friction", "by_law", "dashpots", "crushing", "fracture")
    return np.array([ledger[name][lane] for name in names]) + np.array([0.0, 0.0, ledger.released[lane], 0.0, 0.0])


def place(work, motion, change, twist):
    """Write the motion of a step into the scratch rows of a tile: penetration, its growth, slip at the feet."""
    now = np.add(motion, change)
    work.depth[:] = np.array([-now[0], now[2], -now[1]])[:, None]
    work.growth[:] = np.array([-change[0], change[2], -change[1]])[:, None]
    p1, p2, pr = twist
    for rows, slip in ((work.slip, (p1, p2)), (work.slip_x, (0.0, pr)), (work.slip_y, (-pr, 0.0))):
        rows[:] = np.array(slip)[:, None]
    work.turn[:] = pr


def area_force(work):
    """Resultants of the convex joint in the first lane of a tile, from its scratch."""
    f = work.force[:, 0]
    return np.array([f[2], -f[0], -f[1], -work.twisting[0], -work.y_force[2, 0], work.x_force[2, 0]])


class StaticArea(LoneJoint):
    """A convex joint in the searches."""

    def __init__(self, mu=MU, pressure="full", law=None, outline=OUTLINE):
        x, y = np.ascontiguousarray(outline.T)
        second = np.array([polygons.second_moments(outline)])
        self.joint = area_joints.Areas(
            np.zeros(1, np.int64), np.array([0, len(x)]), np.array([mu]), x, y, np.array([polygons.area(outline)]),
            second, np.array([np.hypot(x, y).max()]), np.array([friction_integrals.area_radius(outline)]),
            friction_integrals.far_moments(outline)[None], np.array([K_N]), np.array([K_S]), np.zeros((1, 3)),
            np.zeros((1, 3)), np.zeros(1), np.zeros(1, np.int64), pressed_parts([pressure], [4]),
            None if law is None else strengths_of(law),
            None if law is None else area_joints.AreaBonds(bond_of(law, 1), *np.zeros((5, 1))),
        )  # fmt: skip
        self.energy = energy_of(None)

    def step(self, motion, change, twist):
        seen = motion_of(np.add(motion, change), change, twist)
        found = area_joints.forces(self.joint, 0, None, seen, (VISCOUS, VISCOUS), self.energy)
        return np.array(found[:6])

    @property
    def bonds(self):
        """Whether the bond is intact, and the rise."""
        return np.stack(self.joint.bonds[:2])


class MovingArea(LoneJoint):
    """The same joint in a tile."""

    def __init__(self, mu=MU, pressure="full", law=None, outline=OUTLINE):
        self.tile, self.work = one(tiles.FIXED), one(tiles.WORK)
        self.tile.viscous[:] = VISCOUS
        self.seen = seen_flat()
        reach, radius = np.hypot(*outline.T).max(), friction_integrals.area_radius(outline)
        face = np.zeros(1, area_tiles.FACE)
        face["second"] = np.array(polygons.second_moments(outline))[:, None]
        fixed = {"k_n": K_N, "k_s": K_S, "friction": mu, "area": polygons.area(outline), "reach": reach}
        for name, value in (fixed | {"radius": radius}).items():
            face[name] = value
        self.joint = area_tiles.Faces(
            joint=np.zeros(1, np.uint32), tile=np.zeros(1, np.int64), lane=np.zeros((1, W), np.uint32),
            used=np.ones(1, np.int64), outline=np.zeros(1, np.uint32), place=np.zeros(1, np.uint32),
            like=np.zeros(1, np.uint32), tiles=face, sheared=np.zeros(1, area_tiles.SHEARED),
            twist=np.zeros((1, 3)), slip=np.zeros(1), count=np.full(1, len(outline)),
            x=np.resize(outline[:, 0], (1, 5)), y=np.resize(outline[:, 1], (1, 5)),
            far=friction_integrals.far_moments(outline)[None], pressed=pressed_parts([pressure], [9]),
            strengths=None if law is None else strengths_of(law),
            bonds=None if law is None else area_tiles.FaceBonds(bond_of(law, 1), np.zeros(1)),
        )  # fmt: skip
        self.energy = EnergyTerms(
            dashpots=np.zeros(1, CARRIED), ledger=np.zeros(1, LEDGER), springs=np.zeros(1, PRESSURE),
            partly=np.ones(1, np.int64), damped=np.zeros(1), lost=np.zeros(1, LOST), least=np.zeros(1),
            share=np.ones(1), place=np.full(1, -1), fallen=np.zeros(0), load=np.zeros((0, 6)), support=np.zeros((0, 6)),
            push=np.zeros((0, 6)), total=np.zeros(1, TOTAL), gravity=np.zeros(3), begun=np.zeros(1),
        )  # fmt: skip

    def step(self, motion, change, twist):
        place(self.work, motion, change, twist)
        law = self.joint.pressed, self.joint.strengths, self.joint.bonds
        energy = self.energy, Counted(self.energy.dashpots[0], self.energy.ledger[0])
        moving_areas.forces_of_tile(self.joint, *law, 0, self.tile, self.seen, self.work, *energy)
        return area_force(self.work)

    @property
    def dissipated(self):
        return lost_of(self.energy.ledger[0], 0)

    @property
    def bonds(self):
        return np.stack(self.joint.bonds)
