"""Joints detected between a few blocks, among them the joint of the laboratory test."""

import numpy as np

from dembrick.assembly import joints as joints_module
from dembrick.assembly.joints import find_joints
from dembrick.geometry.shapes import Polyhedron, box
from helpers.stone_scenes import law

UNTURNED = (1.0, 0.0, 0.0, 0.0)
LAB = (0.3, 0.2, 0.1)


def joints_of(*blocks, fixed=(), tolerance=joints_module.TOLERANCE, formulation="concave"):
    """``blocks``: (edges or shape, position, orientation)."""
    shapes = [edges if isinstance(edges, Polyhedron) else box(edges) for edges, _, _ in blocks]
    where = [position for _, position, _ in blocks]
    turned = [orientation for _, _, orientation in blocks]
    held = [i in fixed for i in range(len(blocks))]
    return find_joints(shapes, where, turned, held, lambda a, b: law(formulation), tolerance)


def lab_joint(formulation="concave", a=0.3, b=0.2, **other):
    joint = joints_of(((a, b, 0.1), (0, 0, -0.05), UNTURNED), ((a, b, 0.1), (0, 0, 0.05), UNTURNED), fixed=[0])[0]
    return joints_module.Joint(**{**vars(joint), "law": law(formulation, **other)})


def rectangle(a, b):
    return np.array([[-a, -b], [a, -b], [a, b], [-a, b]]) / 2.0
