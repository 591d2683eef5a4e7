"""Initial geometry in a history: blocks, joints, actuators, control points and ties at the start."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly.actuators import ACTUATOR, BODY_FORCE, KINDS, PRESSURE
from dembrick.errors import HistoryError
from dembrick.history import guard
from dembrick.scenario.checks import show
from dembrick.scenario.model import FORMULATIONS, PRESSURES

if TYPE_CHECKING:
    import h5py

_EARLIER = {"pressure on ": PRESSURE, "load on ": BODY_FORCE}  # prefixes of names in earlier versions
STRENGTHS = ("cohesion", "tensile_strength", "residual_cohesion", "residual_friction")  # unless all joints are dry
CRUSHING = "compressive_strength"  # recorded if any joint crushes, zero for others; not in files of earlier versions


class InitialGeometry:
    """Initial geometry of a recorded run; read on access, and checked against its counts.

    A subclass opens the file and sets ``path`` and ``_file``, ``begun`` (whether it holds a state) and the counts.
    """

    path: str
    _file: h5py.File
    begun: bool
    n_block: int
    n_joint: int
    n_actuator: int
    n_control_point: int
    n_tie: int

    def _table(self, path: str, *tail: int, count: int | None = None, kind: str = "number") -> np.ndarray:
        if not self.begun:
            return np.zeros((1 if path.endswith("_start") else 0, *tail), int if kind == "integer" else float)
        found = guard.values(guard.dataset(self._file, f"geometry/{path}", kind, (count, *tail)))
        if found.dtype.kind == "f" and not np.isfinite(found).all():
            raise HistoryError(f"{self.path}: geometry/{path} holds a value that is not a finite number")
        return found

    def _texts(self, path: str, count: int) -> list[str]:
        return guard.texts(guard.dataset(self._file, f"geometry/{path}", "text", (count,))) if self.begun else []

    def _starts(self, path: str, count: int, total: int) -> list[int]:
        starts = self._table(path, count=count + 1, kind="integer")
        if starts[0] != 0 or starts[-1] != total or (np.diff(starts) < 0).any():
            raise HistoryError(f"{self.path}: geometry/{path} does not fit its list")
        return starts.tolist()

    def _numbers(self, path: str, limit: int, *tail: int, count: int | None = None) -> np.ndarray:
        found = self._table(path, *tail, count=count, kind="integer")
        if found.size and not 0 <= found.min() <= found.max() < limit:
            raise HistoryError(f"{self.path}: geometry/{path} names something that does not exist")
        return found.astype(np.int64)

    @cached_property
    def block_names(self) -> tuple[str, ...]:
        return tuple(self._texts("blocks/name", self.n_block))

    @property
    def names(self) -> tuple[str, ...]:
        return self.block_names

    @cached_property
    def block_fixed(self) -> np.ndarray:
        """(n_block,) bool: the supports."""
        return self._table("blocks/fixed", count=self.n_block, kind="integer").astype(bool)

    @cached_property
    def block_held(self) -> np.ndarray:
        """(n_block, 6) bool: whether x, y, z, rx, ry, rz of a block are held; all for a support."""
        held = self._optional("blocks/held", 6)
        return np.repeat(self.block_fixed[:, None], 6, axis=1) if held is None else held.astype(bool)

    @cached_property
    def block_mass(self) -> np.ndarray | None:
        """(n_block,) kg; None in files of earlier versions."""
        return self._optional("blocks/mass")

    @cached_property
    def block_inertia(self) -> np.ndarray | None:
        """(n_block, 3, 3) kg m2 about the centroids, body axes; None in files of earlier versions."""
        return self._optional("blocks/inertia", 3, 3)

    def _optional(self, path: str, *tail: int) -> np.ndarray | None:
        folder, _, name = f"geometry/{path}".rpartition("/")
        there = name in guard.members(self._file, folder)
        return self._table(path, *tail, count=self.n_block) if there else None

    @cached_property
    def position0(self) -> np.ndarray:
        """(n_block, 3) m: centroids at the start."""
        return self._table("blocks/position", 3, count=self.n_block)

    @cached_property
    def orientation0(self) -> np.ndarray:
        """(n_block, 4): quaternions at the start."""
        return self._table("blocks/orientation", 4, count=self.n_block)

    @cached_property
    def _shapes(self) -> tuple[list[np.ndarray], list[tuple[tuple[int, ...], ...]]]:
        vertices = self._table("blocks/vertices", 3)
        starts = self._starts("blocks/vertex_start", self.n_block, len(vertices))
        corners = self._numbers("blocks/corner", len(vertices)).tolist()
        n_face = len(self._table("blocks/corner_start", kind="integer")) - 1
        if n_face < 0:
            raise HistoryError(f"{self.path}: geometry/blocks/corner_start is empty")
        corner_start = self._starts("blocks/corner_start", n_face, len(corners))
        faces = [tuple(corners[a:b]) for a, b in zip(corner_start, corner_start[1:], strict=False)]
        face_start = self._starts("blocks/face_start", self.n_block, n_face)
        of_block = [tuple(faces[a:b]) for a, b in zip(face_start, face_start[1:], strict=False)]
        points = [vertices[a:b] for a, b in zip(starts, starts[1:], strict=False)]
        for i, (block, own) in enumerate(zip(of_block, points, strict=True)):
            if any(number >= len(own) for face in block for number in face):
                raise HistoryError(f"{self.path}: a face of block {i} names a vertex that does not exist")
        return points, of_block

    def block_vertices(self, i: int) -> np.ndarray:
        """(nv, 3) m: vertices of block i in its body frame."""
        return self._shapes[0][i]

    def block_faces(self, i: int) -> tuple[tuple[int, ...], ...]:
        """Faces of block i as tuples of vertex numbers, counterclockwise seen from outside."""
        return self._shapes[1][i]

    @cached_property
    def joints(self) -> list[dict]:
        """One dict per joint: blocks, ``origin``, ``axes`` (rows t1, t2, n), ``polygon`` (m, 2), law, contact points;
        ``STRENGTHS`` if any joint has more than friction, and ``compressive_strength`` if any joint crushes (infinite
        for the others)."""
        n = self.n_joint
        if not n:
            return []
        blocks = self._numbers("joints/blocks", self.n_block, 3, count=n).tolist()
        names = {"area": (), "friction": (), "origin": (3,), "axes": (3, 3)}
        columns = {name: self._table(f"joints/{name}", *tail, count=n) for name, tail in names.items()}
        formulation = self._words("joints/formulation", n, FORMULATIONS)
        there = guard.members(self._file, "geometry/joints")
        has_pressure, strong = "pressure" in there, "cohesion" in there
        strengths = {key: self._table(f"joints/{key}", count=n) for key in STRENGTHS} if strong else {}
        if CRUSHING in there:
            crushing = self._table(f"joints/{CRUSHING}", count=n)
            strengths[CRUSHING] = np.where(crushing > 0.0, crushing, np.inf)
        pressure = self._words("joints/pressure", n, PRESSURES) if has_pressure else ["full"] * n
        polygons, points = self._table("joints/polygon", 2), self._table("joints/point", 5)
        p = self._starts("joints/polygon_start", n, len(polygons))
        c = self._starts("joints/point_start", n, len(points))
        joints = []
        for i in range(n):
            joint = dict(zip(("block_a", "block_b", "host"), blocks[i], strict=True))
            joint |= {"area": float(columns["area"][i]), "friction": float(columns["friction"][i])}
            joint |= {"origin": columns["origin"][i], "axes": columns["axes"][i], "formulation": formulation[i]}
            joint |= {"pressure": pressure[i], **{key: float(values[i]) for key, values in strengths.items()}}
            own = points[c[i] : c[i + 1]]
            joint |= {"polygon": polygons[p[i] : p[i + 1]]}
            joint |= {"normal_arms": own[:, :2], "shear_arms": own[:, 2:4], "areas": own[:, 4]}
            joints.append(joint)
        return joints

    def _words(self, path: str, count: int, known: tuple[str, ...]) -> list[str]:
        """Texts from a closed set; HistoryError for any other."""
        found = self._texts(path, count)
        strange = next((word for word in found if word not in known), None)
        if strange is not None:
            raise HistoryError(
                f"{self.path}: geometry/{path} holds {show(strange)}, which is not one of {', '.join(known)}"
            )
        return found

    @cached_property
    def actuators(self) -> list[dict]:
        """One dict per actuator: ``name``, ``block``, ``point``, ``direction``, ``weight``, and its ``kind``, one of
        `assembly.actuators.KINDS`; in files of earlier versions the kind follows from the name."""
        n = self.n_actuator
        names, blocks = self._texts("actuators/name", n), self._numbers("actuators/block", self.n_block, count=n)
        point, direction = (self._table(f"actuators/{name}", 3, count=n) for name in ("point", "direction"))
        weight = self._table("actuators/weight", count=n)
        if "kind" in guard.members(self._file, "geometry/actuators"):
            kinds = self._words("actuators/kind", n, KINDS)
        else:
            kinds = [next((_EARLIER[word] for word in _EARLIER if name.startswith(word)), ACTUATOR) for name in names]
        return [
            {"name": names[i], "block": int(blocks[i]), "point": point[i], "direction": direction[i]}
            | {"weight": float(weight[i]), "kind": kinds[i]}
            for i in range(n)
        ]

    @cached_property
    def loads(self) -> list[dict]:
        """One dict per dead load besides gravity (for a pressure, per face): ``block``, ``point``, ``force`` at the
        start; none in files of earlier versions."""
        if not self.begun or not guard.members(self._file, "geometry/loads"):
            return []
        blocks = self._numbers("loads/block", self.n_block)
        point, force = (self._table(f"loads/{name}", 3, count=len(blocks)) for name in ("point", "force"))
        return [{"block": int(blocks[i]), "point": point[i], "force": force[i]} for i in range(len(blocks))]

    @cached_property
    def control_points(self) -> list[dict]:
        """One dict per control point: ``name``, ``block``, ``point`` at the start."""
        n = self.n_control_point
        if not n:
            return []
        names = self._texts("control_points/name", n)
        blocks = self._numbers("control_points/block", self.n_block, count=n)
        point = self._table("control_points/point", 3, count=n)
        return [{"name": names[i], "block": int(blocks[i]), "point": point[i]} for i in range(n)]

    @cached_property
    def ties(self) -> list[dict]:
        """One dict per tie: ``name``, ``blocks`` (2), ``points`` (2, 3) m at the start."""
        n = self.n_tie
        if not n:
            return []
        blocks = self._numbers("ties/blocks", self.n_block, 2, count=n)
        points = self._table("ties/points", 2, 3, count=n)
        pairs = [" - ".join(self.block_names[i] for i in pair) for pair in blocks.tolist()]
        names = [f"tie {pair}" if pairs.count(pair) == 1 else f"tie {pair} #{k}" for k, pair in enumerate(pairs, 1)]
        return [{"name": names[i], "blocks": blocks[i], "points": points[i]} for i in range(n)]
