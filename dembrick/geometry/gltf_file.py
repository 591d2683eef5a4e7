"""glTF 2.0 files (`.gltf`, `.glb`): the meshes of the nodes of their scene, read without a library.

All contents of a file are checked before use: indices of nodes, meshes, accessors, views and buffers, lengths, and that
the nodes form a tree; so a damaged file gives a clear message. Supported are triangles (lists, strips, fans; indexed or
not) with positions of any component type, nodes with a matrix or with translation, rotation and scale, and buffers
inside the file, in a data URI, or in a file beside it. See the glTF 2.0 specification (Khronos).
"""

from __future__ import annotations

import base64
import binascii
import json
import math
import os
from collections.abc import Iterator
from typing import Any, NamedTuple
from urllib.parse import unquote

import numpy as np

from dembrick.errors import ScenarioError

MOST_CORNERS = 10_000_000  # of all nodes together: one mesh may be used by many nodes
LARGEST_FILE = 64 << 20  # bytes, of a separate buffer file
HARMLESS = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "KHR_mesh_quantization", "KHR_xmp", "EXT_texture_")
COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC3": 3}
INSTANCES = "EXT_mesh_gpu_instancing"  # copies of a mesh at one node; files need not list this extension as required
LIST, STRIP, FAN = 4, 5, 6  # modes of triangles; lower ones are points and lines


class Mesh(NamedTuple):
    """Mesh at one node: its ``name``, corners (n, 3) in the axes of the scene with z up, triangles (t, 3)
    counterclockwise seen from outside."""

    name: str
    corners: np.ndarray
    triangles: np.ndarray


class _Damaged(Exception):
    """The file cannot be read; the message says why."""


def read(path: str) -> list[Mesh]:
    """The meshes of the scene of a file, in the order of its nodes. ScenarioError if it cannot be read."""
    try:
        with open(path, "rb") as file:
            data = file.read()
        with np.errstate(all="ignore"):  # values that are not finite are refused later
            return list(_meshes(_File(path, data)))
    except OSError as error:
        raise ScenarioError(f"{path}: it cannot be read ({error.strerror})") from None
    except _Damaged as error:
        raise ScenarioError(f"{path}: it cannot be read as glTF: {error}") from None


def buffers_beside(path: str) -> list[str]:
    """Paths of a file's external buffers, relative to its folder. Raises ScenarioError if the file cannot be read."""
    try:
        with open(path, "rb") as file:
            scene = _File(path, file.read())
        buffers = [scene.entry("buffers", i, "it") for i in range(len(_listed(scene.document, "buffers")))]
    except OSError as error:
        raise ScenarioError(f"{path}: it cannot be read ({error.strerror})") from None
    except _Damaged as error:
        raise ScenarioError(f"{path}: it cannot be read as glTF: {error}") from None
    named = [buffer.get("uri") for buffer in buffers]
    folder = os.path.realpath(scene.folder)
    places = (
        os.path.relpath(os.path.realpath(os.path.join(folder, unquote(uri))), folder)
        for uri in named
        if isinstance(uri, str) and not uri.startswith("data:") and "\0" not in unquote(uri)
    )
    return [place.replace(os.sep, "/") for place in dict.fromkeys(places)]


class _File:
    """The document of a glTF file, with access to its entries and accessors."""

    def __init__(self, path: str, data: bytes):
        self.folder = os.path.dirname(os.path.abspath(path))
        text, self.binary = _chunks(data) if data[:4] == b"glTF" else (data, None)
        try:
            document = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise _Damaged(str(error)) from None
        if not isinstance(document, dict):
            raise _Damaged("it is not a table of keys")
        self.document = document
        self.buffers: dict[int, bytes] = {}
        for name in _listed(document, "extensionsRequired"):
            if not (isinstance(name, str) and name.startswith(HARMLESS)):
                raise _Damaged(f"it needs the extension {str(name)[:60]!r}, which is not supported; export without it")

    def entry(self, key: str, number: Any, of: str) -> dict[str, Any]:
        """Entry ``number`` of the list ``key``, to which ``of`` refers."""
        entries = _listed(self.document, key)
        number = _whole(number, f"{of} names {key} by number")
        if number >= len(entries):
            raise _Damaged(f"{of} names number {number} of {key}, but there are {len(entries)}")
        if not isinstance(entries[number], dict):
            raise _Damaged(f"number {number} of {key} is not a table of keys")
        return entries[number]

    def _buffer(self, number: Any, of: str) -> bytes:
        buffer = self.entry("buffers", number, of)
        if number not in self.buffers:
            length = _whole(buffer.get("byteLength"), f"buffer {number} has a byteLength")
            data = self._bytes_of(buffer, number)
            if len(data) < length:
                raise _Damaged(f"buffer {number} has only {len(data)} of its {length} bytes")
            self.buffers[number] = data[:length]
        return self.buffers[number]

    def _bytes_of(self, buffer: dict[str, Any], number: int) -> bytes:
        uri = buffer.get("uri")
        if uri is None:
            if number or self.binary is None:
                raise _Damaged(f"buffer {number} has no uri, but its data are not in the file")
            return self.binary
        if not isinstance(uri, str):
            raise _Damaged(f"the uri of buffer {number} is not a text")
        if uri.startswith("data:"):
            head, _, body = uri.partition(",")
            if not head.endswith(";base64"):
                raise _Damaged(f"the data of buffer {number} are not in base64")
            try:
                return base64.b64decode(body, validate=True)
            except (binascii.Error, ValueError):
                raise _Damaged(f"the data of buffer {number} are not base64") from None
        return self._beside(unquote(uri), number)

    def _beside(self, name: str, number: int) -> bytes:
        """The contents of a file in the folder of this one or in a subfolder."""
        place = os.path.realpath(os.path.join(self.folder, name)) if "\0" not in name else ""
        inside = place.startswith(os.path.join(os.path.realpath(self.folder), ""))
        if "://" in name or not inside:
            raise _Damaged(f"the uri of buffer {number} leads out of the folder of the file; keep its data beside it")
        if not os.path.isfile(place):
            raise _Damaged(
                f"there is no ordinary file {name[:100]!r} beside it, which should hold the data of buffer {number}"
            )
        if os.path.getsize(place) > LARGEST_FILE:
            raise _Damaged(f"the file of buffer {number} is longer than {LARGEST_FILE >> 20} MiB")
        with open(place, "rb") as file:
            return file.read()

    def accessor(self, number: Any, kind: str, of: str) -> np.ndarray:
        """Array of an accessor of type ``kind``, (count,) or (count, 3)."""
        entry = self.entry("accessors", number, of)
        what, width = f"accessor {number}", WIDTHS[kind]
        if entry.get("type") != kind:
            raise _Damaged(f"{what} is not a {kind}, but {of} needs one")
        if "sparse" in entry or "bufferView" not in entry:
            raise _Damaged(f"{what} is sparse, which is not supported; export without it")
        component = entry.get("componentType")
        if not isinstance(component, int) or component not in COMPONENTS:
            raise _Damaged(f"{what} has no valid componentType")
        count = _whole(entry.get("count"), f"{what} has a count")
        view = self.entry("bufferViews", entry["bufferView"], what)
        data = self._buffer(view.get("buffer"), f"bufferView of {what}")
        start = _whole(view.get("byteOffset", 0), f"the bufferView of {what} has a byteOffset")
        length = _whole(view.get("byteLength"), f"the bufferView of {what} has a byteLength")
        if start + length > len(data):
            raise _Damaged(f"the bufferView of {what} reaches beyond its buffer")
        dtype = np.dtype(COMPONENTS[component])
        step = _whole(view.get("byteStride", width * dtype.itemsize), f"the bufferView of {what} has a byteStride")
        offset = _whole(entry.get("byteOffset", 0), f"{what} has a byteOffset")
        if step < width * dtype.itemsize or offset + (count - 1) * step + width * dtype.itemsize > length:
            raise _Damaged(f"{what} reaches beyond its bufferView")
        if not count:
            return np.zeros((0, width)) if width > 1 else np.zeros(0, np.int64)
        found: np.ndarray = np.ndarray((count, width), dtype, data, start + offset, (step, dtype.itemsize))
        if kind == "SCALAR":
            if dtype.kind != "u":
                raise _Damaged(f"{what} is used as indices, but does not hold whole numbers")
            return found[:, 0].astype(np.int64)
        scale = float(np.iinfo(dtype).max) if dtype.kind != "f" and entry.get("normalized") is True else 1.0
        return np.maximum(found / scale, -1.0) if scale != 1.0 else found.astype(float)


def _chunks(data: bytes) -> tuple[bytes, bytes | None]:
    """The document and the binary chunk of a GLB file; the latter is None if it is missing."""
    version, length = (int.from_bytes(data[i : i + 4], "little") for i in (4, 8))
    if version != 2 or length > len(data):
        raise _Damaged(
            f"the GLB file states version {version} and {length} bytes; version 2 is needed, and "
            f"{len(data)} bytes are there"
        )
    found, place = [], 12
    while place + 8 <= length:
        size, kind = int.from_bytes(data[place : place + 4], "little"), data[place + 4 : place + 8]
        if place + 8 + size > length:
            raise _Damaged("a chunk of the GLB file reaches beyond its end")
        found.append((kind, data[place + 8 : place + 8 + size]))
        place += 8 + size
    if not found or found[0][0] != b"JSON":
        raise _Damaged("the GLB file does not begin with a chunk of JSON")
    return found[0][1], found[1][1] if len(found) > 1 and found[1][0] == b"BIN\0" else None


def _listed(table: dict[str, Any], key: str) -> list:
    found = table.get(key, [])
    if not isinstance(found, list):
        raise _Damaged(f"{key} is not a list")
    return found


def _whole(value: Any, what: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise _Damaged(f"{what}, but {str(value)[:40]} is not a whole number of at least 0")
    return value


def _numbers(value: Any, count: int, what: str) -> np.ndarray:
    sound = isinstance(value, list) and len(value) == count
    if not sound or any(isinstance(x, bool) or not isinstance(x, int | float) for x in value):
        raise _Damaged(f"{what} is not a list of {count} numbers")
    try:
        found = np.array([float(x) for x in value])
    except OverflowError:
        found = np.array([math.inf])
    if not np.isfinite(found).all():
        raise _Damaged(f"{what} has a number that is not finite")
    return found


# --- the scene ---


def _meshes(file: _File) -> Iterator[Mesh]:
    """The meshes at the nodes of the scene, depth first, rotated from y up in glTF to z up."""
    shapes: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    total = 0
    for number, node, name, transformation in _nodes(file):
        if "mesh" not in node:
            continue
        mesh = file.entry("meshes", node["mesh"], f"node {number}")
        if "skin" in node or np.any([weight != 0 for weight in _listed(mesh, "weights") + _listed(node, "weights")]):
            raise _Damaged(f"node {number} has a skin or morph targets, which are not supported; export it at rest")
        if isinstance(node.get("extensions"), dict) and INSTANCES in node["extensions"]:
            raise _Damaged(f"node {number} has instances ({INSTANCES}), which are not supported; export without them")
        if node["mesh"] not in shapes:
            shapes[node["mesh"]] = _triangles(file, mesh, node["mesh"])
        corners, triangles = shapes[node["mesh"]]
        total += len(corners) + len(triangles)
        if total > MOST_CORNERS:
            raise _Damaged(f"its nodes have more than {MOST_CORNERS} corners and triangles together")
        if not len(triangles):
            continue
        placed = corners @ transformation[:3, :3].T + transformation[:3, 3]
        if not np.isfinite(placed).all():
            raise _Damaged(f"node {number} has corners that are not finite")
        turned = triangles[:, ::-1] if np.linalg.det(transformation[:3, :3]) < 0.0 else triangles
        yield Mesh(name, placed[:, [0, 2, 1]] * [1.0, -1.0, 1.0], turned)


def _nodes(file: _File) -> Iterator[tuple[int, dict[str, Any], str, np.ndarray]]:
    """Index, table, name and transformation to the scene (4, 4) of the nodes of the scene, each once."""
    waiting = [(number, np.eye(4), "the scene") for number in reversed(_roots(file))]
    seen = set()
    while waiting:
        number, above, of = waiting.pop()
        node = file.entry("nodes", number, of)
        if number in seen:
            raise _Damaged(f"node {number} is met twice: the nodes of a scene must be a tree")
        seen.add(number)
        here = above @ _transformation(node, number)
        mesh = file.entry("meshes", node["mesh"], f"node {number}").get("name") if "mesh" in node else None
        yield number, node, str(node.get("name") or mesh or f"node {number}"), here
        waiting += [(child, here, f"node {number}") for child in reversed(_listed(node, "children"))]


def _roots(file: _File) -> list:
    """Indices of the root nodes: those of the default scene, else all nodes without a parent."""
    document = file.document
    if _listed(document, "scenes"):
        return _listed(file.entry("scenes", document.get("scene", 0), "the file"), "nodes")
    nodes = _listed(document, "nodes")
    hanging = {str(child) for node in nodes if isinstance(node, dict) for child in _listed(node, "children")}
    return [number for number in range(len(nodes)) if str(number) not in hanging]


def _transformation(node: dict[str, Any], number: int) -> np.ndarray:
    """Transformation of a node to its parent (4, 4)."""
    if "matrix" in node:
        matrix = _numbers(node["matrix"], 16, f"the matrix of node {number}").reshape(4, 4).T
        if not np.array_equal(matrix[3], [0.0, 0.0, 0.0, 1.0]):
            raise _Damaged(f"the matrix of node {number} does not end with 0, 0, 0, 1 in its fourth row")
        return matrix
    x, y, z, w = _numbers(node.get("rotation", [0, 0, 0, 1]), 4, f"the rotation of node {number}")
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if abs(length - 1.0) > 1e-2:
        raise _Damaged(f"the rotation of node {number} is not a unit quaternion")
    x, y, z, w = x / length, y / length, z / length, w / length
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = turn * _numbers(node.get("scale", [1, 1, 1]), 3, f"the scale of node {number}")
    matrix[:3, 3] = _numbers(node.get("translation", [0, 0, 0]), 3, f"the translation of node {number}")
    return matrix


def _triangles(file: _File, mesh: dict[str, Any], number: int) -> tuple[np.ndarray, np.ndarray]:
    """Corners (n, 3) and triangles (t, 3) of all primitives of a mesh."""
    corners, triangles, first = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
    for primitive in _listed(mesh, "primitives"):
        of = f"mesh {number}"
        if not isinstance(primitive, dict) or not isinstance(primitive.get("attributes"), dict):
            raise _Damaged(f"{of} has a primitive without attributes")
        mode = _whole(primitive.get("mode", LIST), f"{of} has a mode")
        if mode < LIST:
            continue
        if mode > FAN:
            raise _Damaged(f"{of} has a primitive of mode {mode}, but modes are 0 to {FAN}")
        points = file.accessor(primitive["attributes"].get("POSITION"), "VEC3", of)
        if "indices" in primitive:
            order = file.accessor(primitive["indices"], "SCALAR", of)
        else:
            order = np.arange(len(points))
        if len(order) and order.max() >= len(points):
            raise _Damaged(f"{of} has a triangle at corner {order.max()}, but there are {len(points)}")
        corners.append(points)
        triangles.append(first + _three_by_three(order, mode, of))
        first += len(points)
    return np.concatenate(corners), np.concatenate(triangles)


def _three_by_three(order: np.ndarray, mode: int, of: str) -> np.ndarray:
    """Triangles (t, 3) of a list, a strip or a fan of corners."""
    if mode == LIST:
        if len(order) % 3:
            raise _Damaged(f"{of} has triangles with {len(order)} corners, which is not a multiple of 3")
        return order.reshape(-1, 3)
    if mode == FAN:
        return np.stack(
            [order[1:-1], order[2:], np.full(max(len(order) - 2, 0), order[0] if len(order) else 0)], axis=1
        )
    strip = np.stack([order[:-2], order[1:-1], order[2:]], axis=1)
    strip[1::2] = strip[1::2, [0, 2, 1]]
    return strip
