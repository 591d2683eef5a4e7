"""Pictures of the moving blocks, drawn without a display by pyvista.

Where neither EGL nor OSMesa is installed VTK does not raise, it crashes: a child process tries first, once.
"""

from __future__ import annotations

import os
import subprocess
import sys
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import HistoryError, MissingDependency, OutputError, ScenarioError
from dembrick.history.files import check_output, reason, replacing
from dembrick.shapes import rotation_matrix

if TYPE_CHECKING:
    import pyvista

VIEWS = {  # direction from the focus to the camera, and what is up in the picture
    "iso": ((1.0, 1.5, 1.4), (0.0, 0.0, 1.0)),
    "front": ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
    "side": ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "top": ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
}
COLORS = ("displacement", "none")
SIZE = (1600, 1200)  # pixels
_SEEN = 0.12  # of the largest block: how far the farthest corner moves in a picture by itself
_ARROW = {"tip_length": 0.22, "tip_radius": 0.035, "shaft_radius": 0.012}
_PROBE = (
    "import vtkmodules.vtkRenderingOpenGL2 as gl; from vtkmodules.vtkRenderingCore import vtkRenderWindow; "
    "w = vtkRenderWindow(); w.SetOffScreenRendering(1); w.SetSize(8, 8); w.Render(); "
    "raise SystemExit(0 if w.SupportsOpenGL() else 3)"
)


@lru_cache(maxsize=1)
def require_drawing() -> None:
    """MissingDependency unless pyvista is installed and this machine can draw off screen."""
    if not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    try:
        import pyvista  # noqa: F401
    except ImportError as error:
        raise MissingDependency("pictures of blocks need pyvista; install it with: pip install pyvista") from error
    try:
        done = subprocess.run([sys.executable, "-c", _PROBE], capture_output=True, timeout=60, check=False)
        works = done.returncode == 0
    except (OSError, subprocess.TimeoutExpired):
        works = False
    if not works:
        raise MissingDependency(
            "this machine cannot draw off screen: install EGL and a driver "
            "(Debian and Ubuntu: apt install libegl1 libgl1-mesa-dri) and try again"
        )


def meshes(history, frame: int = -1, magnification: float = 1.0) -> pyvista.MultiBlock:
    """The blocks in one frame as a MultiBlock of PolyData, by name, with ``displacement`` (m, true) at the vertices.

    ``magnification`` multiplies the motion: translation and turning angle of each block.
    """
    import pyvista

    number = _frame(history, frame)
    blocks = pyvista.MultiBlock()
    for i, name in enumerate(history.block_names):
        start, true, drawn = _vertices(history, number, i, magnification)
        mesh = pyvista.PolyData(drawn, faces=_faces(history.block_faces(i)))
        mesh.point_data["displacement"] = np.linalg.norm(true - start, axis=1)
        blocks.append(mesh, name)
    return blocks


def picture(
    history,
    path: str | os.PathLike,
    *,
    frame: int = -1,
    time: float | None = None,
    view: str = "iso",
    magnification: float | None = None,
    color: str = "displacement",
    size: tuple[int, int] = SIZE,
) -> str:
    """Write a PNG of one frame: the blocks, where they started, jacks, torsion centre; the path.

    ``frame`` counts from the end where negative; ``time`` (s) takes the nearest frame instead. Without
    ``magnification`` the motion is blown up until it is seen; the picture says how much.
    """
    path = os.fspath(path)
    for name, value, known in (("view", view, VIEWS), ("color", color, COLORS)):
        if value not in known:
            raise ScenarioError(f"{name} = {value!r} is unknown; use one of {', '.join(known)}")
    if magnification is not None and not (np.isfinite(magnification) and magnification >= 0.0):
        raise ScenarioError(f"magnification = {magnification!r} is out of range: it must be finite and at least 0")
    if os.path.splitext(path)[1].lower() != ".png":
        raise OutputError(f"{path}: a picture is written as PNG; let the name end in .png")
    target = check_output(path)
    number = _frame(history, frame if time is None else nearest_frame(history, time))
    require_drawing()
    import pyvista

    factor = automatic_magnification(history, number) if magnification is None else float(magnification)
    plotter = pyvista.Plotter(off_screen=True, window_size=list(size))
    try:
        _draw(plotter, history, number, factor, view, color)
        with replacing(target) as part:
            # the part's name has no ending that pyvista knows, so the picture is written here
            image = plotter.screenshot(return_img=True)
            _write_png(image, part)
    except OSError as error:
        raise OutputError(f"{path}: the picture cannot be written ({reason(error)}); choose another path") from error
    finally:
        plotter.close()
    return path


def nearest_frame(history, time: float) -> int:
    """Number of the frame nearest to a time (s)."""
    _frame(history, 0)
    return int(np.argmin(np.abs(history.frame_time - time)))


def automatic_magnification(history, frame: int) -> float:
    """1, 2 or 5 times a power of ten, at least 1, that makes the farthest corner's motion visible; 1 without motion."""
    moved = largest = 0.0
    for i in range(history.n_block):
        start, true, _ = _vertices(history, frame, i, 1.0)
        moved = max(moved, float(np.linalg.norm(true - start, axis=1).max()))
        largest = max(largest, float(np.ptp(start, axis=0).max()))
    if moved <= 1e-12 * largest:
        return 1.0
    wanted = _SEEN * largest / moved
    if wanted <= 1.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= wanted * (1.0 + 1e-9)))


def _frame(history, frame: int) -> int:
    if history.n_frames == 0:
        raise HistoryError(f"{history.path}: no frames were recorded in this history, so there is nothing to draw")
    if not -history.n_frames <= frame < history.n_frames:
        raise ScenarioError(f"frame {frame} is out of range: {history.path} has frames 0 to {history.n_frames - 1}")
    return frame % history.n_frames


def _vertices(history, frame: int, i: int, factor: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """World coordinates of block i's vertices at the start, in the frame, and with the motion magnified."""
    body, place = history.block_vertices(i), history.position0[i]
    first, now = rotation_matrix(history.orientation0[i]), rotation_matrix(history.frame_orientation(frame)[i])
    shift = history.frame_displacement(frame)[i]
    start = body @ first.T
    turned = body @ now.T
    drawn = start @ _times(now @ first.T, factor).T
    return place + start, place + shift + turned, place + factor * shift + drawn


def _times(rotation: np.ndarray, factor: float) -> np.ndarray:
    """The rotation about the same axis by ``factor`` times the angle, at most half a turn."""
    skew = 0.5 * (rotation - rotation.T)
    axis = np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
    sine = float(np.linalg.norm(axis))
    angle = float(np.arctan2(sine, 0.5 * (np.trace(rotation) - 1.0)))
    if factor == 1.0 or sine < 1e-15:
        return rotation
    cross = skew / sine
    angle = min(angle * factor, np.pi)
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def _faces(faces) -> np.ndarray:
    return np.concatenate([(len(face), *face) for face in faces])


def _draw(plotter, history, frame: int, factor: float, view: str, color: str) -> None:
    blocks, start = meshes(history, frame, factor), meshes(history, frame, 0.0)
    length = max(float(np.ptp(mesh.points, axis=0).max()) for mesh in start)
    largest = max(float(mesh["displacement"].max()) for mesh in blocks)
    unit, scale = next(((u, s) for u, s in (("m", 1.0), ("mm", 1e3)) if largest * s >= 0.1), ("µm", 1e6))
    plotter.set_background("white")
    bar = {"title": f"displacement [{unit}]", "color": "black", "n_labels": 4, "fmt": "%.3g", "vertical": True}
    bar |= {"position_x": 0.86, "position_y": 0.2, "height": 0.55, "width": 0.06}
    bar |= {"title_font_size": 26, "label_font_size": 26}
    for i, (mesh, rest) in enumerate(zip(blocks, start, strict=True)):
        if history.block_fixed[i] or color == "none":
            plotter.add_mesh(mesh, color="#CFCFCF", ambient=0.3)
        else:
            mesh.point_data["shown"] = scale * mesh["displacement"]
            plotter.add_mesh(mesh, scalars="shown", cmap="cividis", clim=(0.0, max(scale * largest, 1e-12)),
                             ambient=0.3, scalar_bar_args=bar)  # fmt: skip
        plotter.add_mesh(mesh.extract_all_edges(), color="black", line_width=3)
        if not history.block_fixed[i]:
            plotter.add_mesh(rest.extract_all_edges(), color="#777777", line_width=2, opacity=0.8)
    _draw_jacks(plotter, history, frame, factor, length)
    marked = _draw_centre(plotter, history, length)
    shown = f"motion x {factor:g}" if factor != 1.0 else "true scale"
    text = f"{history.title}\ntime {history.frame_time[frame]:.4g} s, {shown}; grey: start; red: jacks"
    plotter.add_text(
        text + ("; blue: torsion centre" if marked else ""),
        position="upper_left",
        color="black",
        font_size=round(plotter.window_size[0] / 100),
    )
    direction, up = VIEWS[view]
    bounds = np.array(plotter.bounds)
    focus = 0.5 * (bounds[::2] + bounds[1::2])
    plotter.enable_parallel_projection()
    plotter.camera_position = [tuple(focus + 10.0 * length * np.array(direction)), tuple(focus), up]
    plotter.reset_camera()
    plotter.camera.zoom(1.2)


def _draw_jacks(plotter, history, frame: int, factor: float, length: float) -> None:
    """An arrow of one length a jack, pushing at its point, which rides on the drawn block."""
    import pyvista

    for jack in history.actuators:
        i = jack["block"]
        first, now = rotation_matrix(history.orientation0[i]), rotation_matrix(history.frame_orientation(frame)[i])
        arm = _times(now @ first.T, factor) @ (jack["point"] - history.position0[i])
        tip = history.position0[i] + factor * history.frame_displacement(frame)[i] + arm
        way = jack["direction"] * np.sign(jack["weight"])
        # the head of the arrow lies outside the block, so that a jack inside it is seen in every view
        reach = float((history.block_vertices(i) @ first.T @ way).max() - (jack["point"] - history.position0[i]) @ way)
        arrow = pyvista.Arrow(start=tip, direction=way, scale=reach + 0.35 * length, **_ARROW)
        plotter.add_mesh(arrow, color="#D55E00")
        plotter.add_mesh(pyvista.Sphere(radius=0.015 * length, center=tip), color="#D55E00")


def _draw_centre(plotter, history, length: float) -> bool:
    """A thin axis through the torsion centre of the pushed joint; whether there is one."""
    import pyvista

    found = (history.results.get("yield_point") or {}).get("torsion_centre")
    pushed = {jack["block"] for jack in history.actuators}
    joint = next((j for j in history.joints if pushed & {j["block_a"], j["block_b"]}), None)
    if found is None or joint is None:
        return False
    centre = joint["origin"] + np.asarray(found, float) @ joint["axes"][:2]
    if np.linalg.norm(centre - joint["origin"]) > 2.0 * length:
        return False  # nearly pure shear: a mark far away would shrink the blocks
    axis = pyvista.Cylinder(center=centre, direction=joint["axes"][2], radius=0.006 * length, height=1.1 * length)
    plotter.add_mesh(axis, color="#0072B2")
    return True


def _write_png(image: np.ndarray, path: str) -> None:
    import pyvista
    from vtkmodules.vtkIOImage import vtkPNGWriter

    grid = pyvista.ImageData(dimensions=(image.shape[1], image.shape[0], 1))
    grid.point_data["rgb"] = np.ascontiguousarray(image[::-1, :, :3]).reshape(-1, 3)
    grid.set_active_scalars("rgb")
    writer = vtkPNGWriter()
    writer.SetFileName(path)
    writer.SetInputData(grid)
    writer.Write()
    if writer.GetErrorCode() or not os.path.getsize(path):
        raise OSError("the PNG writer failed")
