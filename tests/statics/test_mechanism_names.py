"""Names of the motion of a joint at its limit."""

import pytest

from dembrick.simulation.mechanism import joint_mechanism


@pytest.mark.parametrize(
    ("twist", "centre", "name"),
    [
        ((1.0, 0.0, 1e-5), None, "sliding"),  # 3e-6 at the edge: rounding of a search, no centre 100 km away
        ((1.0, 0.0, 1e-3), (0.0, 1e3), "torsion-shear"),
        ((0.0, 0.3, 1.0), (-0.3, 0.0), "torsion-shear"),
        ((0.0, 3e-7, 1.0), (-3e-7, 0.0), "torsion"),
    ],
)
def test_a_motion_has_its_name_at_the_rim(twist, centre, name):
    assert joint_mechanism(twist, (0.0, 0.0), 0.3) == (None if centre is None else pytest.approx(centre), name)


def test_a_joint_that_tilts_more_than_it_slips_rocks():
    assert joint_mechanism((1e-3, 0.0, 0.0), (0.0, 1.0), 0.3) == (None, "rocking")
