"""Combined features: 60 random scenes, each judged by limit analysis, a second method and an equivalent scene."""

import pytest

from dembrick.errors import DembrickError
from helpers.places import tool_module

PARTS = 6
features = tool_module("drawn_features")


@pytest.fixture(scope="module")
def drawn():
    return features.scenes(60, 1, quick=True)


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
