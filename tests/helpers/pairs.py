"""Two blocks and the contact between them, positioned by the test."""

import functools
import math

import numpy as np

from dembrick.assembly.broad_phase import bodies_of, overlap_depths
from dembrick.geometry.convex_hull import hull, prism
from dembrick.geometry.rotations import quaternion_product, rotation_matrix, unit_quaternion
from dembrick.geometry.shapes import box
from dembrick.kernels.dynamics.contact_forces import TOUCHED, clear_applied, touch
from dembrick.kernels.dynamics.rigid_bodies import Bodies
from dembrick.kernels.dynamics.tiles import FIXED, SEEN, Links
from dembrick.scenario.model import JointLaw
from dembrick.simulation.dynamics.contact_state import parts_table, scratch_for, touching_pairs

K_N, K_S = 1e10, 4e9
BLOCK = box((0.3, 0.2, 0.1))


def quaternion(axis, angle):
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    return np.array([math.cos(angle / 2), *(math.sin(angle / 2) * axis)])


def no_joints():
    """`Links` of a scene without joints."""
    numbers, rows, few = np.zeros(0, np.uint32), np.zeros(0), np.zeros(0, np.float32)
    return Links(
        host=numbers, other=numbers, tangents=numbers, plane=numbers, axes=np.zeros((0, 2, 3)), place=numbers,
        tiles=np.zeros(0, FIXED), like=numbers, seen_tiles=np.zeros(0, SEEN), wrenches=rows,
        ends=np.zeros((0, 2, 16), np.uint32), kept=np.zeros((0, 4)), reach=few, slack=few,
        glide=np.zeros((0, 3), np.float32),
    )  # fmt: skip


class Pair:
    """Two blocks of one convex part each, and the contact between them."""

    def __init__(self, first, second, friction=0.6, ratio=0.0):
        self.shapes = (first, second)
        mass = np.array([2000.0 * shape.volume for shape in self.shapes])
        inertia = np.array([2000.0 * shape.inertia for shape in self.shapes])
        self.bodies = Bodies(
            np.arange(2, dtype=np.uint32), np.zeros((2, 3)), np.zeros((2, 3, 3)), np.zeros((2, 4)),
            *np.zeros((3, 2, 3)), mass, np.linalg.inv(inertia),
            np.array([0.5 * shape.diameter for shape in self.shapes]), np.zeros((2, 3)), np.zeros((2, 6)),
            np.zeros(3, np.uint32), np.zeros(0, np.uint32), np.zeros(0, np.uint32), np.zeros((0, 6), bool),
            np.zeros((0, 6)),
        )  # fmt: skip
        parts = parts_table(self.shapes)
        law = JointLaw("convex", friction, K_N, K_S)
        self.contact = touching_pairs(parts, scratch_for(parts), np.ones(2), [[0, 1]], [-1], [law], ratio)
        self.place(0, (0.0, 0.0, 0.0))

    def place(self, block, position, orientation=(1.0, 0.0, 0.0, 0.0)):
        q = unit_quaternion(orientation)
        self.bodies.position[block], self.bodies.orientation[block] = position, q
        self.bodies.rotation[block] = rotation_matrix(q)

    def touch(self, dt=1e-6):
        clear_applied(self.contact, self.bodies)
        status = touch(self.contact, no_joints(), self.bodies, dt)
        assert status == TOUCHED
        return self.bodies.applied[1].copy()

    def wrench(self, position, orientation=(1.0, 0.0, 0.0, 0.0)):
        """Force and torque on the second block in a given pose."""
        self.place(1, position, orientation)
        return self.touch()

    def potential(self):
        """Integral of the smaller pressure over the common volume, and its derivative, the wrench on the second block:
        the integral of -2 kn n where that block has the smaller depth. Its points are independent of the surfaces."""
        ends = [(self.corners(i).min(axis=0), self.corners(i).max(axis=0)) for i in (0, 1)]
        low, high = np.max([low for low, _ in ends], axis=0), np.min([high for _, high in ends], axis=0)
        golden = 1.2207440846057596  # the root of x^4 = x + 1 spreads points evenly and off any planes
        for n in (300_000, 300_001, 1_000_000):
            points = low + (high - low) * ((np.arange(n)[:, None] * golden ** -np.arange(1.0, 4.0) + 0.5) % 1.0)
            if n < 1_000_000:  # a tighter box about the common volume
                inside = points[np.minimum(self.depth(0, points)[0], self.depth(1, points)[0]) > 0.0]
                low, high = (
                    np.maximum(low, inside.min(axis=0) - 0.3 * np.ptp(inside, axis=0)),
                    np.minimum(high, inside.max(axis=0) + 0.3 * np.ptp(inside, axis=0)),
                )
        cell = np.prod(high - low) / n
        depth, normal = zip(*(self.depth(i, points) for i in (0, 1)), strict=True)
        common = (depth[0] > 0.0) & (depth[1] > 0.0)
        energy = 2.0 * K_N * np.minimum(*depth)[common].sum() * cell
        own = common & (depth[1] < depth[0])
        force = -2.0 * K_N * cell * normal[1][own]
        torque = np.cross(points[own] - self.bodies.position[1], force)
        return energy, np.concatenate([force.sum(axis=0), torque.sum(axis=0)])

    def corners(self, block):
        return self.bodies.position[block] + self.shapes[block].vertices @ self.bodies.rotation[block].T

    def depth(self, block, points):
        """Distance to the nearest face plane and that face's normal, for points (k, 3)."""
        normals = self.shapes[block].face_normals @ self.bodies.rotation[block].T
        heights = self.shapes[block].face_offsets - (points - self.bodies.position[block]) @ normals.T
        return heights.min(axis=1), normals[np.argmin(heights, axis=1)]


def turned(*turns):
    q = np.array([1.0, 0.0, 0.0, 0.0])
    for axis, angle in turns:
        q = quaternion_product(quaternion(axis, angle), q)
    return q


WEDGE = prism([(-0.1, 0.0), (0.1, 0.0), (0.0, 0.15)], 0.2)
TETRA = hull([(0.0, 0.0, 0.0), (0.2, 0.0, 0.02), (0.0, 0.25, 0.0), (0.03, 0.02, 0.2)])
SETTINGS = {  # shape, direction of approach, orientation, overlap (m)
    "edge in face": (BLOCK, (0.1, 0.05, 1.0), turned(((0, 1, 0), 0.7)), 4e-3),
    "corner in face": (BLOCK, (0.1, 0.05, 1.0), turned(((0, 1, 0), 0.7), ((1, 0, 0), 0.5)), 8e-3),
    "edge on edge": (BLOCK, (1.0, 0.02, 0.9), turned(((0, 1, 0), 0.8), ((0, 0, 1), 0.9)), 6e-3),
    "corner at corner": (BLOCK, (0.25, 0.17, 0.1), turned(((1, 2, 3), 0.6)), 5e-3),
    "face in face, askew": (BLOCK, (0.2, 0.1, 1.0), turned(((0, 0, 1), 0.4), ((1, 0, 0), 0.03)), 5e-3),
    "face on edge of face": (BLOCK, (1.4, 0.1, 1.0), turned(((0, 0, 1), 0.2), ((0, 1, 0), 0.05)), 4e-3),
    "wedge": (WEDGE, (0.1, 0.05, 1.0), turned(((1, 1, 0), 1.2)), 4e-3),
    "tetrahedron": (TETRA, (0.5, 0.3, 1.0), turned(((1, -1, 2), 2.2)), 4e-3),
}


@functools.cache
def set_up(name, **more):
    """The pair of a setting; the second block is moved along the direction until the overlap is the given one."""
    shape, direction, orientation, overlap = SETTINGS[name]
    pair = Pair(BLOCK, shape, **more)
    near, far = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (near + far)
        pair.place(1, middle * np.array(direction), orientation)
        parts = bodies_of(pair.shapes, pair.bodies.position, pair.bodies.rotation)
        near, far = (middle, far) if overlap_depths(parts, np.array([[0, 1]]))[0] > overlap else (near, middle)
    return pair
