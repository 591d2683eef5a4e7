"""Stand-ins for an assembly, records of known numbers, and checks of what a reader finds in them."""

from types import SimpleNamespace

import numpy as np

from dembrick import history
from dembrick.assembly.actuators import NO_ACTUATORS, NO_CONTROL_POINTS, ActuatorTable, Attached, ControlPoints
from dembrick.assembly.contact_points import PointTable
from dembrick.assembly.joints import Joint, JointTable
from dembrick.assembly.loads import NO_LOADS
from dembrick.assembly.ties import NO_TIES
from dembrick.scenario import model
from dembrick.scenario.controls import DisplacementControl, DynamicControl
from dembrick.simulation.channels import energies

SCENARIO = 'title = "two blocks, one joint"\ngravity = [0.0, 0.0, -9.81]\n'
FACES = ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
ENERGIES = energies(real_time=False)
MOTION = DynamicControl(1.0)  # of records in real time
CONSTANT_RATE = DisplacementControl(1e-3, travel=1e-3)
RESULTS = {"title": "two blocks", "V": np.float64(216.05), "list": np.arange(2), "none": None}


def shape(edges):
    corners = [(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)]
    return SimpleNamespace(vertices=0.5 * np.array(corners) * edges, faces=FACES)


def wedge():
    """A triangular prism: faces of three and of four corners."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]], float)
    faces = ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5))
    return SimpleNamespace(vertices=0.1 * (vertices - vertices.mean(axis=0)), faces=faces)


def joint(a, b, formulation="concave", origin=(0.0, 0.0, 0.0)):
    polygon = np.array([[-0.15, -0.1], [0.15, -0.1], [0.15, 0.1], [-0.15, 0.1]])
    law = SimpleNamespace(formulation=formulation, friction=0.64, pressure="full", dry=True)
    arms = {"arm_a": np.zeros(3), "arm_b": np.zeros(3)}
    return Joint(a, b, b, np.array(origin), np.eye(3), polygon, area=0.06, law=law, gap=0.0, **arms)


def assembly():
    """Two blocks, one concave joint, one jack."""
    joints = (joint(0, 1),)
    points = (
        SimpleNamespace(normal_arm=joints[0].polygon, shear_arm=0.93 * joints[0].polygon, area=np.full(4, 0.015)),
    )
    return SimpleNamespace(
        names=("lower", "upper"),
        shapes=[shape((0.3, 0.2, 0.1)), shape((0.3, 0.2, 0.1))],
        position=np.array([[0.0, 0.0, -0.05], [0.0, 0.0, 0.05]]),
        orientation=np.array([[1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]]),
        fixed=np.array([True, False]),
        supporting=np.array([True, False]),
        held=np.array([[True] * 6, [False] * 6]),
        mass=np.array([9.0, 9.0]),
        inertia=np.array([np.diag([0.0375, 0.075, 0.0975])] * 2),
        joints=JointTable.of(joints),
        contact_points=PointTable.of(points),
        ties=NO_TIES,
        custom_law=None,
        point_loads=NO_LOADS,
        control_points=ControlPoints(
            ("mark",), Attached(np.array([1]), np.array([[0.0, 0.0, 0.05]]), np.array([[0.0, 0.0, 0.05]]))
        ),
        actuators=ActuatorTable(
            names=("jack",),
            at=Attached(np.array([1]), np.array([[0.075, 0.0, -0.05]]), np.array([[0.075, 0.0, -0.05]])),
            direction=np.array([[0.0, 1.0, 0.0]]),
            weight=np.array([1.0]),
            kind=("actuator",),
        ),
    )


def mixed_assembly():
    """A box, a rotated wedge and no jack; a convex joint, which has no contact points, after a concave one."""
    base = assembly()
    turn = np.array([np.cos(0.2), 0.0, np.sin(0.2), 0.0])
    base.names, base.shapes = ("lower", "upper", "wedge, small"), [*base.shapes, wedge()]
    base.position = np.vstack([base.position, [0.4, 1000.0, 0.2]])
    base.orientation = np.vstack([base.orientation, turn])
    base.fixed = base.supporting = np.array([True, False, False])
    base.held = np.repeat(base.fixed[:, None], 6, axis=1)
    base.mass, base.inertia = np.array([9.0, 9.0, 0.75]), np.concatenate([base.inertia, [1e-3 * np.eye(3) + 1e-4]])
    base.joints = JointTable.of((*base.joints, joint(1, 2, "convex", origin=(0.0, 0.0, 0.1))))
    base.contact_points = PointTable.of((*base.contact_points, None))
    base.control_points = NO_CONTROL_POINTS
    base.actuators = NO_ACTUATORS
    return base


def many_blocks(n):
    base = assembly()
    base.names, base.shapes = tuple(f"b{i}" for i in range(n)), [shape((0.3, 0.2, 0.1))] * n
    base.position = np.column_stack([0.4 * np.arange(n), np.zeros(n), np.zeros(n)])
    base.orientation = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    base.fixed = base.supporting = np.arange(n) == 0
    base.held = np.repeat(base.fixed[:, None], 6, axis=1)
    base.mass, base.inertia = np.full(n, 9.0), np.tile(base.inertia[0], (n, 1, 1))
    return base


def record(start, stop, n_joint=1, n_actuator=1, names=ENERGIES):
    """Rows start to stop; every number follows from its row, so a reader can identify any that is wrong."""
    row = np.arange(start, stop, dtype=float)
    column = row[:, None]
    return {
        "time": 1e-5 * row,
        "load": 100.0 + row,
        "displacement": 1e-8 * row,
        "unbalanced": 1.0 / (1.0 + row),
        "lower": 99.0 + row,
        "upper": 101.0 + row,
        "actuator_displacement": 1e-8 * column + np.arange(n_actuator),
        "actuator_force": 3.0 * column + np.arange(n_actuator),
        "control_point": 1e-6 * column[:, :, None] + np.array([[[0.0, 1e-3, 2e-3]]]),
        "reaction": column[:, :, None] + 0.5 * np.arange(6),
        "joint": column[:, :, None] + 10.0 * np.arange(n_joint)[None, :, None] + 0.1 * np.arange(7),
        "energy": {name: (i + 1) * row for i, name in enumerate(names)},
    }


def frames(start, stop, n_block=2):
    """Frames start to stop: all blocks but the first translate, and rotate about a skew axis."""
    frame = np.arange(start, stop, dtype=float)
    moving = np.arange(n_block) > 0
    displacement = frame[:, None, None] * moving[None, :, None] * np.array([1e-9, -2e-3, 3e-6])
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    angle = 0.01 * frame[:, None] * moving
    orientation = np.concatenate([np.cos(angle / 2)[..., None], np.sin(angle / 2)[..., None] * axis], axis=2)
    return 1e-4 * frame, displacement, orientation


def to_and_fro():
    """Four frames: undeformed, rotated by 0.03, then by a tenth and by a thousandth of that."""
    parts = [frames(k, k + 1) for k in (0.0, 3.0, 0.3, 0.003)]
    displacement, orientation = (np.concatenate([part[i] for part in parts]) for i in (1, 2))
    return 1e-4 * np.arange(4.0), displacement, orientation


def motion(start, stop, n_block=2, n_point=4):
    """Velocity, spin and contact forces of frames start to stop."""
    frame = np.arange(start, stop, dtype=float)[:, None, None]
    axis, block, point = np.arange(3.0), np.arange(n_block)[:, None], np.arange(n_point)[:, None]
    return {
        "velocity": frame + 0.1 * axis + 10.0 * block,
        "spin": -frame + 0.2 * axis + 10.0 * block,
        "contact_force": 100.0 * frame + axis + 0.01 * point,
    }


def new_contacts(start, stop):
    """New contacts of frames start to stop: none, one, two or three per frame; each number identifies its contact."""
    count = np.arange(start, stop) % 4
    number = np.arange(count.sum()) + (np.arange(start) % 4).sum()
    along, value = np.arange(3.0), number[:, None] + 0.25
    values = {"point": value + along, "normal": value - along, "force": value * 10.0 + along, "torque": -value - along}
    blocks = np.column_stack([np.zeros_like(number), np.ones_like(number)])
    return {"count": count, "blocks": blocks, **values, "area": 0.5 * number, "slip": number + 0.125}


def check_new_contacts(found, stop):
    """The new contacts are exactly those of frames 0 to stop of `new_contacts`, whichever frames are read."""
    for start in {0, stop // 2, max(stop - 1, 0)}:
        expected = new_contacts(start, stop)
        starts, values = found.frame_new_contacts(start, stop)
        np.testing.assert_array_equal(np.diff(starts), expected.pop("count"))
        assert set(values) == set(expected)
        for name, value in expected.items():
            np.testing.assert_array_equal(values[name], value, err_msg=name)


def open_writer(path, blocks=None, **options):
    return history.HistoryWriter(path, SCENARIO, blocks or assembly(), {"time_step": 1e-5}, **options)


def written(path, rows, poses=None, blocks=None, *, status="completed", results=None, moving=None, **options):
    """A finished history, open to be read, of these rows and of frames with these ``poses`` and ``moving`` channels."""
    with history.HistoryWriter(path, SCENARIO, blocks or assembly(), {}, **options) as writer:
        if rows is not None:
            writer.append(rows)
        if poses is not None:
            writer.append_frames(*poses, **(moving or {}))
        writer.finish(status, results or {})
    return history.read(path)


def moving_record(start, stop, n_joint=1, n_actuator=1):
    """Rows start to stop of a run in real time: with the number of new contacts and more energies."""
    rows = record(start, stop, n_joint, n_actuator, energies(real_time=True))
    return rows | {"new_contacts": np.arange(start, stop) % 4}


def moved(start, stop):
    """Positions of O of the joint and of its four contact points, and their areas, from the frame numbers."""
    number, points = np.arange(start, stop, dtype=float)[:, None, None], np.arange(4.0)
    arms, areas = number + points[:, None] + [0.0, 0.5], number[..., 0] + points
    return {"joint_shift": number + np.zeros((1, 2)), "contact_arm": arms, "contact_area": areas}


def finished(path, in_real_time=False, **options):
    """A finished history of 20 rows and 4 frames at ``path``, with all channels."""
    options |= {"control": MOTION} if in_real_time else {}
    with open_writer(path, channels=model.CHANNELS, **options) as out:
        out.append((moving_record if in_real_time else record)(0, 20))
        shifted = {"joint_shift": np.zeros((4, 1, 2)), "contact_arm": np.zeros((4, 4, 2))}
        shifted |= {"contact_area": np.ones((4, 4))}
        out.append_frames(*frames(0, 4), **motion(0, 4), **shifted, new_contacts=new_contacts(0, 4))
        out.finish("yield", RESULTS)
    return path


def without_new_contacts(path):
    """A finished history of a run in real time whose frames lack the forces of new contacts."""
    moving = {"joint_shift": np.zeros((4, 1, 2))}
    return written(path, moving_record(0, 5), frames(0, 4), moving=moving, control=MOTION)


def check_rows(found, stop, n_joint=1, n_actuator=1):
    """All series hold exactly rows 0 to stop of ``record``."""
    names = energies(found.in_real_time)
    expected = record(0, stop, n_joint, n_actuator, names)
    assert found.n_row == stop
    for name in ("time", "load", "displacement", "unbalanced", "reaction"):
        np.testing.assert_array_equal(getattr(found, name), expected[name], err_msg=name)
    for name in ("lower", "upper", "actuator_displacement", "actuator_force"):
        np.testing.assert_array_equal(found.series(name), expected[name], err_msg=name)
    for i, name in enumerate(("N", "V_1", "V_2", "M_T", "M_1", "M_2", "slip")):
        np.testing.assert_array_equal(found.joint(name), expected["joint"][:, :, i], err_msg=name)
    assert set(found.energy) == set(names)
    for name, values in found.energy.items():
        np.testing.assert_array_equal(values, expected["energy"][name], err_msg=name)


def check_frames(found, stop, blocks):
    """The frames are exactly 0 to stop of ``frames``."""
    times, displacement, orientation = frames(0, stop, len(blocks.names))
    assert found.n_frames == stop
    np.testing.assert_array_equal(found.frame_time, times)
    for k in range(stop):
        np.testing.assert_array_equal(found.frame("displacement", k), displacement[k])
        np.testing.assert_array_equal(found.frame("orientation", k), orientation[k])
        np.testing.assert_array_equal(found.frame("position", k), blocks.position + displacement[k])
