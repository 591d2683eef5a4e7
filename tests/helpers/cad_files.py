"""CAD files of boxes in every format, written by hand to test the readers."""

import base64
import json

import numpy as np

from dembrick.geometry import stl_file

QUADS = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
TRIANGLES = [(q[0], q[i], q[i + 1]) for q in QUADS for i in (1, 2)]
# a gate, in mm: two posts 200 wide and 1000 high and a lintel across them; drawn to a tenth of a millimetre or three
GATE = {
    "ground": ((-500.0, -500.0, -100.0), (1500.0, 800.0, 0.0)),
    "left": ((0.0, 0.0, 0.2), (200.0, 300.0, 1000.0)),
    "right": ((800.0, 0.0, -0.1), (1000.0, 300.0, 999.8)),
    "lintel": ((-50.0, 0.0, 1000.1), (1050.0, 300.0, 1200.0)),
}


def corners(low, high):
    return np.array([[x, y, z] for z in (low[2], high[2]) for y in (low[1], high[1]) for x in (low[0], high[0])])


def obj(path, boxes=GATE, word="o", faces=QUADS):
    lines, first = [], 1
    for name, ends in boxes.items():
        lines += [f"{word} {name}", *("v {:.9g} {:.9g} {:.9g}".format(*point) for point in corners(*ends))]
        lines += ["f " + " ".join(f"{i + first}/1/1" for i in face) for face in faces]
        first += 8
    path.write_text("\n".join(lines) + "\n")


def text_stl(path, boxes=GATE, names=True):
    lines = []
    for name, ends in boxes.items():
        points = corners(*ends)
        lines.append(f"solid {name}" if names else "solid")
        for face in TRIANGLES:
            lines += [
                "facet normal 0 0 0",
                "outer loop",
                *("vertex {:.9g} {:.9g} {:.9g}".format(*points[i]) for i in face),
            ]
            lines += ["endloop", "endfacet"]
        lines.append(f"endsolid {name}" if names else "endsolid")
    path.write_text("\n".join(lines) + "\n")


def binary_stl(path, boxes=GATE):
    triangles = np.zeros(12 * len(boxes), stl_file.TRIANGLE)
    triangles["corner"] = np.concatenate([corners(*ends)[np.array(TRIANGLES)] for ends in boxes.values()])
    path.write_bytes(b"a model of bodies".ljust(80) + len(triangles).to_bytes(4, "little") + triangles.tobytes())


def gltf(path, boxes=GATE, binary=False):
    """In metres with y upwards, as the format prescribes; the node of the second solid translates it to its place."""
    blob, views, accessors, meshes, nodes = b"", [], [], [], []
    for i, (name, ends) in enumerate(boxes.items()):
        x, y, z = (1e-3 * corners(*ends)).T
        points = np.stack([x, z, -y], axis=1) - (i == 1) * np.array([1.0, 2.0, 3.0])
        for data, kind in ((points.astype("<f4"), 5126), (np.array(TRIANGLES, "<u2"), 5123)):
            views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": data.nbytes})
            count = len(data) if kind == 5126 else data.size
            entry = {"bufferView": len(views) - 1, "componentType": kind, "count": count}
            ends_of = {"min": data.min(axis=0).tolist(), "max": data.max(axis=0).tolist()} if kind == 5126 else {}
            accessors.append(entry | {"type": "VEC3" if kind == 5126 else "SCALAR"} | ends_of)
            blob += data.tobytes()
        primitive = {"attributes": {"POSITION": 2 * i}, "indices": 2 * i + 1}
        meshes.append({"name": name, "primitives": [primitive]})
        nodes.append({"mesh": i, "name": name} | ({"translation": [1.0, 2.0, 3.0]} if i == 1 else {}))
    document = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(len(nodes)))}], "nodes": nodes}
    document |= {"meshes": meshes, "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": len(blob)}]}
    if not binary:
        document["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
        path.write_text(json.dumps(document))
        return
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    blob += b"\0" * (-len(blob) % 4)
    chunks = len(text).to_bytes(4, "little") + b"JSON" + text + len(blob).to_bytes(4, "little") + b"BIN\0" + blob
    path.write_bytes(b"glTF" + (2).to_bytes(4, "little") + (12 + len(chunks)).to_bytes(4, "little") + chunks)


def compas(path, boxes=GATE, old=False):
    blocks = {}
    for i, (name, ends) in enumerate(boxes.items()):
        vertex = {str(k): dict(zip("xyz", point.tolist(), strict=True)) for k, point in enumerate(corners(*ends))}
        data = {"attributes": {"name": name}, "vertex": vertex, "face": {str(k): list(f) for k, f in enumerate(QUADS)}}
        if old:
            data["face"] = {k: [str(i) for i in face] for k, face in data["face"].items()}
        block = {"dtype": "compas_assembly.datastructures/Block", "data": data}
        blocks[str(i)] = data if old else {"block": block, "is_support": name == "ground"}
    graph = {"dtype": "compas.datastructures/Graph", "data": {"node": blocks, "edge": {"0": {"1": {"vertex": None}}}}}
    new = {"dtype": "compas_assembly.datastructures/Assembly", "data": {"graph": graph}}
    path.write_text(json.dumps({"assembly": {"vertex": {"0": {}}}, "blocks": blocks} if old else new))
