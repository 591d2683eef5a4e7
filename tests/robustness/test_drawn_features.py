"""Combined features: the 42 random scenes that contain every pair of them, each judged by limit analysis, a second
method and an equivalent scene."""

from itertools import combinations, product

import pytest

from dembrick.errors import DembrickError
from helpers.places import tool_module

PARTS = 6
features = tool_module("drawn_features")


@pytest.fixture(scope="module")
def drawn():
    return features.scenes(42, 1, quick=True)


def test_every_pair_is_drawn(drawn):
    for one, other in combinations(features.QUICK, 2):
        seen = {(levels[one], levels[other]) for _, levels, _ in drawn}
        assert seen == {*product(features.QUICK[one], features.QUICK[other])}


@pytest.mark.parametrize("part", range(PARTS))
def test_no_answer_is_wrong(part, drawn, monkeypatch):
    monkeypatch.setattr(features, "PATIENCE", 60.0)
    answered = 0
    for number, levels, seed in drawn[part::PARTS]:
        try:
            one = features.drawn(number, levels, seed)
        except DembrickError:
            continue  # such a scene cannot be expressed
        verdict, why = features.judged(one, deformed=False)
        assert verdict != "WRONG", (number, levels, why)
        answered += verdict in ("right", "told")
    assert answered >= 4
