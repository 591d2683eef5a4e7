"""Tables of the forces of every joint and every support of a recorded run at one moment."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.views.motion.frames import frame_number, in_collapse, nearest
from dembrick.views.motion.joints import STATES, JointMotion

if TYPE_CHECKING:
    from dembrick.history.reader import History
    from dembrick.views.motion.joint_frames import JointFrames

UNITS = {
    "N": "N",
    "V_1": "N",
    "V_2": "N",
    "M_T": "N m",
    "M_1": "N m",
    "M_2": "N m",
    "e_1": "m",
    "e_2": "m",
    "slip": "m",
    "open_share": "1",
    "utilisation": "1",
}

REACTION = ("F_x", "F_y", "F_z", "M_x", "M_y", "M_z")
CONTACT = {"N": "N", "V": "N", "M_T": "N m", "area": "m2", "slip": "m", "x": "m", "y": "m", "z": "m"}
HANDED_OVER = "handed over"  # state of a joint whose two blocks now bear more on a new contact than on the joint
_FLAT = 0.7  # cosine of the angle between the normals of a joint and of a new contact that has taken its place


class Moment(NamedTuple):
    """The moment of a table: the ``frame`` with the motion, the ``row`` with the forces, and their times
    ``frame_time`` and ``time`` (s, or the number of the equilibrium)."""

    frame: int
    row: int
    frame_time: float
    time: float


def moment(history: History, frame: int | str | None = None, time: float | None = None) -> Moment:
    """The moment of a frame and the row nearest to it, or the frame and the row nearest to a ``time`` (s)."""
    number = frame_number(history, frame, time, in_rows=True)
    shown = float(history.frame_time[number])
    row = int(nearest(history.time, [shown if time is None else time])[0]) if history.n_row else 0
    return Moment(number, row, shown, float(history.time[row]) if history.n_row else shown)


def joint_table(history: History, frame: int | str | None = None, time: float | None = None) -> list[dict]:
    """One dict per joint: ``joint`` (its two blocks), ``state`` and the quantities of ``UNITS``, in a frame, or at a
    ``time`` (s) with the forces of the row and the motion of the frame nearest to it.

    Resultants are the action of the second block on the first, in the axes t1 and t2 of the joint, about its initial
    centroid O, which moves with the host of its polygon. ``e_1`` and ``e_2``: the point where the force meets the face
    of the host, from O along its own t1 and t2: (M_2, -M_1) / N if the joint has not opened far, the toe of a rocking
    block at any rotation; None if the joint carries nothing. ``open_share``: share of its area over which it is open.
    ``utilisation``: the gauge of V_1, V_2 and M_T in the joint's yield domain at its N, or the eccentricity of N over
    its limit, whichever is greater; None if not known, as for a joint that was ``HANDED_OVER``, see
    `new_contact_table`. HistoryError if frames or joint forces were not recorded.
    """
    if not history.has_joints:
        history.joint("N")  # raises, and says what to record
    at = moment(history, frame, time)
    joints = JointMotion(history)
    moved = now = joints.at([at.frame])
    if time is not None:  # contact forces and bonds come from the frame nearest to the row
        now = joints.at([int(nearest(history.frame_time, [at.time])[0])], [at.row])
    columns = dict(zip(("N", "V_1", "V_2", "M_T", "M_1", "M_2", "slip"), now.about_start[0].T, strict=True))
    columns["e_1"], columns["e_2"] = np.where(columns["N"] > 0.0, (now.shift + now.pressed_arm)[0].T, np.nan)
    columns["open_share"], columns["utilisation"] = moved.relative.open_share[0], now.utilisation[0]
    names, state = history.block_names, [STATES[number] for number in moved.relative.state[0]]
    for j in _handed_over(history, moved, at.frame):
        state[j], columns["utilisation"][j] = HANDED_OVER, np.nan
    return [
        {"joint": f"{names[joints.block_a[j]]}/{names[joints.block_b[j]]}", "state": state[j]}
        | {name: float(columns[name][j]) if np.isfinite(columns[name][j]) else None for name in UNITS}
        for j in range(joints.n_joint)
    ]


def cut_joints(history: History, frame: int) -> list[str]:
    """The joints, by their two blocks, that were cut in a frame or before as they slid over an edge."""
    shift = history.frame_values("joint_shift", frame, frame + 1)
    names, cut = history.block_names, [] if shift is None else np.flatnonzero(shift[0].any(axis=1)).tolist()
    return [f"{names[history.joints[j]['block_a']]}/{names[history.joints[j]['block_b']]}" for j in cut]


def _handed_over(history: History, now: JointFrames, frame: int) -> list[int]:
    """Joints replaced by new contacts of the same blocks with the same normal and a greater normal force."""
    met = history.frame_new_contacts(frame, frame + 1)
    if met is None or not len(met[1]["area"]):
        return []
    joints, axes, found = now.joints, now.acting_axes[0], []
    blocks, across = met[1]["blocks"], (met[1]["force"] * met[1]["normal"]).sum(axis=1)
    for j in np.flatnonzero(np.isin(joints.block_a, blocks) & np.isin(joints.block_b, blocks)):
        own = (blocks == [joints.block_a[j], joints.block_b[j]]).all(axis=1)
        own |= (blocks == [joints.block_b[j], joints.block_a[j]]).all(axis=1)
        own &= np.abs(met[1]["normal"] @ axes[j, 2]) > _FLAT
        if across[own].sum() > max(now.resultants[0, j, 0], 0.0):
            found.append(int(j))
    return found


def new_contact_table(history: History, frame: int | str | None = None, time: float | None = None) -> list[dict] | None:
    """One dict per contact that formed during the run and carries a force, in a frame or in that nearest to a ``time``
    (s): ``contact`` (its two blocks) and the quantities of ``CONTACT``: normal and shear force, torque about the
    normal, and centre of pressure in world axes. None if such forces act but were not recorded."""
    if not history.in_real_time:
        return []
    at = moment(history, frame, time)
    recorded = history.frame_new_contacts(at.frame, at.frame + 1)
    if recorded is None:
        return None if history.n_row and history.new_contacts[at.row] else []
    met, names = recorded[1], history.block_names
    N, torque = ((met[name] * met["normal"]).sum(axis=1) for name in ("force", "torque"))
    V = np.linalg.norm(met["force"] - N[:, None] * met["normal"], axis=1)
    columns = np.column_stack([N, V, torque, met["area"], met["slip"], met["point"]]).tolist()
    return [
        {"contact": f"{names[a]}/{names[b]}"} | dict(zip(CONTACT, values, strict=True))
        for (a, b), values in zip(met["blocks"].tolist(), columns, strict=True)
    ]


def reaction_table(history: History, frame: int | str | None = None, time: float | None = None) -> list[dict]:
    """One dict per support: ``support``, and the force ``F_x``, ``F_y``, ``F_z`` (N) and moment ``M_x``, ``M_y``,
    ``M_z`` (N m, about its initial centroid) that it exerts on the structure, in the row nearest to a frame or to a
    ``time`` (s); zero, like the joint forces, in frames of a collapse, which have no row."""
    if not (history.n_support and history.n_row):
        return []
    at = moment(history, frame, time)
    reaction = history.reaction[at.row]
    if time is None and in_collapse(history, [at.frame])[0]:
        reaction = np.zeros_like(reaction)
    return [
        {"support": name} | dict(zip(REACTION, wrench, strict=True))
        for name, wrench in zip(history.support_names, reaction.tolist(), strict=True)
    ]
