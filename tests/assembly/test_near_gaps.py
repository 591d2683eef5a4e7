"""The warning about blocks that nearly touch but share no joint, whatever part of the scenario they come from."""

from dembrick.assembly.build import assemble
from dembrick.scenario import toml
from helpers.cad_files import obj
from helpers.scenario_text import block, header

FLOOR = block("floor", (0.0, 0.0, -0.05), (4.0, 4.0, 0.1), "fixed = true")
TILT = '[control]\nkind = "tilt"\naxis = [0.0, 1.0, 0.0]\n'


def remarks(text, path=None):
    found = assemble(toml.loads(header(normal_stiffness=1e11) + text + TILT, path))
    return [warning for warning in found.warnings if "share no joint" in warning]


def beside(gap, turn=""):
    """Two cubes of 0.3 m on a floor with a ``gap`` between them (m)."""
    first = block("left", (0.0, 0.0, 0.15), (0.3, 0.3, 0.3))
    return FLOOR + first + block("right", (0.3 + gap, 0.0, 0.15), (0.3, 0.3, 0.3), turn)


def test_blocks_that_were_written_by_hand_are_told():
    """Gaps are reported from the tolerance of joints, 0.5 um, up to 5e-3 of the diameter sqrt(3) 0.3 m, 2.6 mm."""
    assert remarks(beside(1e-5)) == [
        "1 pair of faces up to 0.01 mm apart share no joint, among them those of 'left' and 'right'; if they are to "
        "touch, move the blocks onto one plane"
    ]
    assert "up to 2.5 mm apart" in remarks(beside(2.5e-3))[0]
    assert remarks(beside(2.7e-3)) == remarks(beside(0.0)) == remarks(beside(1e-8)) == []


def test_faces_that_share_a_strip_along_an_edge_are_none():
    """A cube on a base 1 mm lower than the cube beside it: their faces share only a strip 1 mm high, not reported."""
    base = block("base", (0.301, 0.0, 0.1495), (0.3, 0.3, 0.299)) + block("upper", (0.301, 0.0, 0.449), (0.3, 0.3, 0.3))
    found = remarks(FLOOR + block("left", (0.0, 0.0, 0.15), (0.3, 0.3, 0.3)) + base)
    assert len(found) == 1 and found[0].startswith("1 pair of faces up to 1 mm") and "'left' and 'base'" in found[0]


def test_what_a_generator_lays_is_told_where_it_meets_others():
    stack = '[[stacks]]\nname = "pier"\nmaterial = "stone"\nbox = [0.3, 0.3, 0.3]\nblocks = 2\n'
    prop = block("prop", (0.30002, 0.0, 0.15), (0.3, 0.3, 0.3))
    (found,) = remarks(FLOOR + prop + stack)
    assert "among them those of 'prop' and 'pier.1'" in found
    assert remarks(FLOOR + stack) == []


def test_a_model_beside_a_block_is_told_once(tmp_path):
    """A gap within a model is reported with its gap_tolerance, a gap between model and floor by the general warning."""
    obj(tmp_path / "two.obj", {"a": ((0.0, 0.0, 1e-4), (0.3, 0.3, 0.3)), "b": ((0.3001, 0.0, 0.0), (0.6, 0.3, 0.3))})
    model = '[[models]]\nname = "m"\nfile = "two.obj"\nunit = "m"\nmaterial = "stone"\n'
    text = FLOOR + model + block("prop", (-0.15, 0.15, 0.15), (0.3, 0.3, 0.3))
    found = remarks(text, str(tmp_path / "scene.toml"))
    assert ["gap_tolerance" in one for one in found] == [True, False]
    assert found[1].startswith(
        "1 pair of faces up to 0.1 mm apart share no joint, among them those of 'floor' and 'm.a'"
    )
