"""The critical time step of assemblies against the true greatest frequency, by dense eigenvalues."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dembrick import assembly, stability
from dembrick.model import Block, JointLaw, Material, Scenario, YieldControl
from dembrick.simulation import assembled_stiffness, block_stiffness, initial_state


def wall(courses: int, blocks: int, formulation: str, densities=(1500.0,)) -> assembly.Assembly:
    """Running bond without half blocks: every other course is moved by half a block, on a base that carries both."""
    length, width, height = 0.3, 0.2, 0.1
    materials = {f"stone{i}": Material(density) for i, density in enumerate(densities)}
    whole = (length * (blocks + 0.5), width, height)
    stones = [Block("base", "stone0", whole, (0.5 * whole[0], 0.0, -0.5 * height), fixed=True)]
    for row in range(courses):
        for i in range(blocks):
            x = length * (i + 0.5 + 0.5 * (row % 2))
            material = f"stone{(row + i) % len(densities)}"
            stones.append(Block(f"s{row}_{i}", material, (length, width, height), (x, 0.0, (row + 0.5) * height)))
    return assembly.build(
        Scenario(
            title="wall",
            gravity=(0.0, 0.0, -9.81),
            joint=JointLaw(formulation, 0.64, 1e10, 4e9),
            materials=materials,
            blocks=tuple(stones),
            control=YieldControl(),
        )
    )


def true_frequency(built) -> float:
    state = initial_state(built)
    K, inertia = assembled_stiffness(state), stability.block_inertia(built)[state.blocks.free]
    M = np.zeros_like(K)
    for i, block in enumerate(inertia):
        M[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = block
    lower = np.linalg.inv(np.linalg.cholesky(M))
    return math.sqrt(np.linalg.eigvalsh(lower @ K @ lower.T)[-1])


@pytest.mark.parametrize("formulation", ["concave", "corrected", "convex"])
@pytest.mark.parametrize("size, least", [((1, 1), 0.9999), ((10, 1), 0.97), ((3, 3), 0.85), ((10, 10), 0.8)])
def test_the_step_is_safe_and_not_wasteful(formulation, size, least):
    built = wall(*size, formulation)
    state = initial_state(built)
    bound = stability.greatest_frequency(state, stability.block_inertia(built), block_stiffness(state, shared=1.0))
    ratio = true_frequency(built) / bound
    assert least <= ratio <= 1.0 + 1e-12


@pytest.mark.parametrize("ratio", [1e-3, 1.0, 1e3])
def test_the_step_is_safe_for_unequal_neighbours(ratio):
    built = wall(6, 2, "concave", densities=(1500.0, 1500.0 * ratio))
    state = initial_state(built)
    bound = stability.greatest_frequency(state, stability.block_inertia(built), block_stiffness(state, shared=1.0))
    assert 0.75 <= true_frequency(built) / bound <= 1.0 + 1e-12
