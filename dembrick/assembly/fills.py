"""Fills as forces on blocks: on each bare face that looks up, the column above it and the pressure from the side.

With sigma(z) = gamma (z_s - z) on a face of outward normal n, the traction is -sigma (K n_x, K n_y, n_z) per area: the
area that the face shows from above times sigma, and that which it shows from the side times K sigma. All of it is
parallel on one face, so that the resultant acts at the centre of sigma, as that of a pressure does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly.surface_pressures import FACING, FaceForce, faces_that_look, resultant
from dembrick.errors import ScenarioError
from dembrick.scenario.checks import show

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.fills import Fill


def fill_forces(fill: Fill, members, bare: Assembly) -> list[FaceForce]:
    """The forces of a fill on the blocks ``members`` of an assembly, one a face that bears it.

    ScenarioError if no free block of them has a bare face that looks up below the surface.
    """
    share, found = np.array([fill.ratio, fill.ratio, 1.0]), []
    for face in faces_that_look(lambda normal: bool(normal[2] > FACING), members, bare):
        force, arm = resultant(face, fill.at_height, bare)
        if force > 0.0:
            found.append(FaceForce(face.block, arm, -share * face.normal * force))
    if not found:
        raise ScenarioError(
            f"the fill on {show(fill.block)}: no free block of it has a bare face that looks up below surface = "
            f"{fill.surface:g} m; check block and surface"
        )
    return found
