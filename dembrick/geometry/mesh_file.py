"""Shapes from mesh files: STL and OBJ, and PLY, gmsh .msh and .vtu, which are read with meshio. All are checked here.

A file contains a surface of triangles and polygons, or a solid mesh whose boundary is extracted. Corners that nearly
coincide are merged (STL repeats them). The surface must be closed; faces with inward normals are reversed if this is
unambiguous. A solid that is not convex is cut into convex parts along its own faces. Faces must be plane; messages
identify a faulty face by its number in the file, from 0, and by its centre.
"""

from __future__ import annotations

import contextlib
import io
import os
import warnings

import numpy as np

from dembrick.errors import ScenarioError, needed
from dembrick.geometry import obj_file, stl_file
from dembrick.geometry.convex_hull import FLAT, hull, mass_properties
from dembrick.geometry.convex_parts import convex_parts
from dembrick.geometry.shapes import LARGEST, SMALLEST, Polyhedron

ENDINGS = (".stl", ".obj", ".ply", ".msh", ".vtu")
LARGEST_FILE = 16 << 20  # bytes
_SAME = 1e-9  # of the size: corners this close are one
_MOST_CORNERS = 2000  # of a convex block: a hull with more is a scan and not a block
_SURFACES = ("triangle", "quad", "polygon")
_NO_CELLS = ("vertex", "line")  # ignored: gmsh writes them beside the surface or solid, in variants by number of points
_SOLIDS = {  # faces of the cells of solid meshes, oriented outward
    "tetra": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    "hexahedron": ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (2, 3, 7, 6), (0, 4, 7, 3), (1, 2, 6, 5)),
    "wedge": ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (0, 3, 5, 2)),
    "pyramid": ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
}


def convex_solids(path: str, scale: float = 1.0) -> list[Polyhedron]:
    """The convex parts of the solid whose surface is in a file, with lengths times ``scale`` in metres; one part if it
    is convex.

    Raises ScenarioError for a file that cannot be read, and for a surface that is open, inside out, flat, or has too
    many parts; MissingDependency if meshio is needed and missing.
    """
    points, faces = read_surface(path)
    try:
        return checked(points * scale, faces)
    except ScenarioError as error:
        raise ScenarioError(f"{path}: {error}") from None


def checked(points: np.ndarray, faces: list[tuple[int, ...]]) -> list[Polyhedron]:
    """The convex parts of a solid with surface ``faces`` (indices of ``points``), checked as described above."""
    if not faces:
        raise ScenarioError("there is no surface in the file; a block needs one that is closed")
    if not np.isfinite(points).all():
        raise ScenarioError("a corner has a coordinate that is not a finite number")
    used = np.unique(np.concatenate([np.array(face) for face in faces]))
    size = float(np.ptp(points[used], axis=0).max())
    if not size > 0.0:
        raise ScenarioError("all corners are at one point; a block needs a volume")
    if not SMALLEST <= size <= LARGEST:
        raise ScenarioError(
            f"the surface is {size:.3g} m across; blocks measure from {SMALLEST:g} to {LARGEST:g} m: give the right "
            "unit or scale of its lengths"
        )
    spread = np.linalg.svd(points[used] - points[used].mean(axis=0), compute_uv=False)
    if not spread[-1] > _SAME * spread[0]:
        raise ScenarioError("the surface is flat: all its corners lie in a plane; a block needs a volume")
    points, faces = _welded(points, faces, _SAME * size)
    if not faces:
        raise ScenarioError("no face of the surface has an area; a block needs a volume")
    faces = _looking_outward(points, faces)
    _check_closed(points, faces)
    volume, _, _ = mass_properties(points, [face for _, face in faces])
    if abs(volume) <= _SAME * size**3:
        raise ScenarioError(f"the surface is flat: it encloses {abs(volume):.3g} m3; a block needs a volume")
    if volume < 0.0:
        raise ScenarioError(
            f"the surface is inside out: its faces look inward (volume {volume:.6g} m3), {_face(points, faces[0])} for "
            "one; reverse the order of the corners of every face"
        )
    corners = np.unique(np.concatenate([np.array(face) for _, face in faces]))
    if len(corners) > _MOST_CORNERS:
        bound = f"at most {_MOST_CORNERS} are allowed: simplify the mesh"
        raise ScenarioError(f"the surface has {len(corners)} corners; {bound}")
    if _before_faces(points, faces, size) > 2.0 * FLAT * size:
        return convex_parts(points, [face for _, face in faces])
    solid = hull(points[corners])
    if abs(solid.volume / volume - 1.0) > 10.0 * FLAT:
        raise ScenarioError(
            f"the surface encloses {volume:.9g} m3, but its convex hull {solid.volume:.9g} m3: it overlaps itself; "
            "mend the mesh"
        )
    return [solid]


class _Ended(io.BufferedReader):
    """A file that stops readers which continue at its end: that for PLY would loop forever."""

    _PATIENCE = 1000  # empty reads that are allowed

    def __init__(self, path: str):
        super().__init__(io.FileIO(path))
        self._left = self._PATIENCE

    def readline(self, size: int | None = -1, /) -> bytes:
        return self._handed(super().readline(size))

    def read(self, size: int | None = -1, /) -> bytes:
        return self._handed(super().read(size))

    def _handed(self, data: bytes) -> bytes:
        self._left = self._PATIENCE if data else self._left - 1
        if self._left < 0:
            raise EOFError("it ends before its data does")
        return data


def _meshio_mesh(path: str, ending: str):
    """Read a mesh with meshio; the format is given, as meshio would otherwise try all formats with that extension."""
    import meshio

    if ending != ".ply":  # the other readers stop at the end of the file
        return meshio.read(path, {".msh": "gmsh"}.get(ending, ending[1:]))
    with _Ended(path) as file:
        return meshio.read(file, "ply")


def check_file(path: str, endings: tuple[str, ...], largest: int) -> None:
    """Raise a ScenarioError unless ``path`` is a regular file with one of the endings and at most ``largest`` bytes."""
    ending = os.path.splitext(path)[1].lower()
    if ending not in endings:
        raise ScenarioError(f"mesh file {path}: its ending is {ending or 'none'}; use one of {', '.join(endings)}")
    if not os.path.isfile(path):
        what = "this is not an ordinary file" if os.path.exists(path) else "there is no such file"
        raise ScenarioError(f"mesh file {path}: {what}")
    if os.path.getsize(path) > largest:
        raise ScenarioError(f"mesh file {path}: longer than {largest >> 20} MiB, so it is a scan and not a block")


def read_surface(path: str) -> tuple[np.ndarray, list[tuple[int, ...]]]:
    """Corners (n, 3) and faces of the surface in a file."""
    ending = os.path.splitext(path)[1].lower()
    check_file(path, ENDINGS, LARGEST_FILE)
    if ending == ".obj":
        drawn = obj_file.read(path)
        return drawn.points, drawn.faces
    if ending == ".stl":
        points = stl_file.read(path).points
        return points, stl_file.triangles_of(points)
    needed("meshio", "a block from a mesh file")
    try:
        # meshio reports some errors by SystemExit after printing them, and others as warnings
        silence = contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO())
        with silence[0], silence[1], warnings.catch_warnings(action="ignore"):
            mesh = _meshio_mesh(path, ending)
    except (Exception, SystemExit) as error:  # its readers raise anything on a broken file
        reason = " ".join(str(error).split()) or type(error).__name__
        if isinstance(error, SystemExit):
            reason = "its contents do not match its ending"
        raise ScenarioError(f"mesh file {path}: it cannot be read as {ending[1:]}: {reason[:200]}") from None
    if not len(mesh.points):
        raise ScenarioError(f"mesh file {path}: there is no surface in it; a block needs one that is closed")
    points = np.asarray(mesh.points, float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ScenarioError(f"mesh file {path}: its corners have {points.shape[-1]} coordinates; a block needs 3")
    faces: list[tuple[int, ...]] = []
    skin: dict[frozenset[int], tuple[int, ...] | None] = {}
    for cells in mesh.cells:
        if cells.type in _SURFACES:
            faces += [tuple(int(i) for i in cell) for cell in cells.data]
        elif cells.type not in _SOLIDS and cells.type.rstrip("0123456789") not in _NO_CELLS:
            raise ScenarioError(
                f"mesh file {path}: it has cells of kind {cells.type}; export a mesh of the first order, of "
                f"{', '.join(_SURFACES)}, {', '.join(_SOLIDS)}"
            )
        shown = _SOLIDS.get(cells.type, ())
        if any(len(cell) <= max(map(max, shown)) for cell in cells.data if shown):
            raise ScenarioError(
                f"mesh file {path}: a cell of kind {cells.type} has fewer corners than such a cell needs"
            )
        for face in shown:
            for cell in cells.data:
                corners = tuple(int(cell[i]) for i in face)
                key = frozenset(corners)
                skin[key] = None if key in skin else corners  # a face between two cells is internal
    outside = [corners for corners in skin.values() if corners is not None]
    found = outside or faces  # beside a solid, gmsh writes its surface as well
    if any(len(face) < 3 for face in found):
        raise ScenarioError(f"mesh file {path}: a face has fewer than three corners")
    if any(min(face) < 0 or max(face) >= len(points) for face in found):
        raise ScenarioError(f"mesh file {path}: a face names a corner that does not exist")
    return points, found


def _welded(points, faces, tolerance: float) -> tuple[np.ndarray, list[tuple[int, tuple[int, ...]]]]:
    """Merge corners that nearly coincide; return the faces with their numbers, without those of zero area."""
    points, number = np.unique(points, axis=0, return_inverse=True)
    number = number.reshape(-1)
    if len(points) > 10 * _MOST_CORNERS:
        raise ScenarioError(f"the file has {len(points)} different corners; a block can have at most {_MOST_CORNERS}")
    same = np.arange(len(points))
    for i in range(len(points)):  # sorted by x, so that candidates follow closely
        for j in range(i + 1, len(points)):
            if points[j, 0] - points[i, 0] > tolerance:
                break
            if same[j] == j and (np.abs(points[j] - points[i]) <= tolerance).all():
                same[j] = same[i]
    kept = []
    for index, face in enumerate(faces):
        corners = [int(same[number[i]]) for i in face]
        corners = [c for k, c in enumerate(corners) if c != corners[k - 1]]
        if len(corners) >= 3 and len(set(corners)) == len(corners):
            kept.append((index, tuple(corners)))
    return points, kept


def _face(points, numbered) -> str:
    index, face = numbered
    middle = points[list(face)].mean(axis=0)
    return f"face {index} (about {middle[0]:.4g}, {middle[1]:.4g}, {middle[2]:.4g})"


def _looking_outward(points, faces) -> list[tuple[int, tuple[int, ...]]]:
    """Orient all faces of a connected surface outward if every edge has two faces; otherwise return them unchanged.
    Neighbours that traverse their common edge in opposite senses are oriented alike, and the volume is positive: this
    determines the orientation uniquely."""
    sides: dict[tuple[int, int], list[tuple[int, bool]]] = {}
    for number, (_, face) in enumerate(faces):
        for edge in zip(face[-1:] + face[:-1], face, strict=True):
            sides.setdefault((min(edge), max(edge)), []).append((number, edge[0] < edge[1]))
    if any(len(both) != 2 for both in sides.values()):
        return faces
    beside: list[list[tuple[int, bool]]] = [[] for _ in faces]  # neighbours; whether oriented oppositely
    for (a, up), (b, other_up) in sides.values():
        beside[a].append((b, up == other_up))
        beside[b].append((a, up == other_up))
    turned = {0: False}
    waiting = [0]
    while waiting:
        here = waiting.pop()
        for there, other in beside[here]:
            if there not in turned:
                turned[there] = turned[here] != other
                waiting.append(there)
            elif turned[there] != (turned[here] != other):
                return faces  # a one-sided surface
    if len(turned) < len(faces):
        return faces
    found = [(index, face[::-1] if turned[i] else face) for i, (index, face) in enumerate(faces)]
    if mass_properties(points, [face for _, face in found])[0] < 0.0:
        found = [(index, face[::-1]) for index, face in found]
    return found


def _check_closed(points, faces) -> None:
    """Check that every edge is traversed once in each sense; other counts mean a hole or a reversed face."""
    walked: dict[tuple[int, int], tuple] = {}
    for numbered in faces:
        face = numbered[1]
        for i in range(len(face)):
            edge = (face[i - 1], face[i])
            if edge in walked:
                raise ScenarioError(
                    f"{_face(points, numbered)} and {_face(points, walked[edge])} run along an edge the same way: one "
                    "of them looks inward, or three faces meet in that edge; mend the mesh"
                )
            walked[edge] = numbered
    open_edges = [numbered for (i, j), numbered in walked.items() if (j, i) not in walked]
    if open_edges:
        raise ScenarioError(
            f"the surface is not closed: {len(open_edges)} edges have a face on one side only, one of them at "
            f"{_face(points, open_edges[0])}; fill the holes"
        )


def _before_faces(points, faces, size: float) -> float:
    """Greatest height of a corner above the plane of a face (m): zero for a convex solid."""
    corners = np.unique(np.concatenate([np.array(face) for _, face in faces]))
    worst = 0.0
    for numbered in faces:
        p = points[list(numbered[1])]
        normal = 0.5 * np.cross(p - p[0], np.roll(p, -1, axis=0) - p[0]).sum(axis=0)
        length = float(np.linalg.norm(normal))
        # the plane of a sliver is too inaccurate
        if length <= FLAT * size * float(np.sqrt(((p - np.roll(p, 1, axis=0)) ** 2).sum(axis=1)).max()):
            continue
        height = (points[corners] - p.mean(axis=0)) @ (normal / length)
        bent = float(np.abs((p - p.mean(axis=0)) @ (normal / length)).max())
        if bent > FLAT * size:
            raise ScenarioError(
                f"{_face(points, numbered)} is not plane: its corners are up to {bent:.3g} m off; draw plane faces"
            )
        worst = max(worst, float(height.max()))
    return worst
