"""Fixtures of the tests of pictures and pages."""

import pytest

import dembrick
from dembrick.errors import MissingDependency
from dembrick.scenario import shipped
from dembrick.views import page
from dembrick.views.render import screen
from helpers import history_cases as cases


@pytest.fixture
def drawing():
    """Skip the test on a machine that cannot draw."""
    try:
        screen.require_drawing()
    except MissingDependency as error:
        pytest.skip(str(error))


@pytest.fixture
def run(tmp_path):
    told = {"title": "two blocks", "yield_point": {"torsion_centre": [-0.05, 0.0]}}
    told = {"status": "yield", "results": told, "control": cases.CONSTANT_RATE}
    with cases.written(tmp_path / "run.h5", cases.record(0, 5), cases.frames(0, 4), **told) as found:
        yield found


@pytest.fixture(scope="session")
def lab_page(tmp_path_factory):
    """A run of the constant-rate test of set 4b with corner points, and its page."""
    folder = tmp_path_factory.mktemp("page")
    scenario = dembrick.load(shipped.folder() / "set4b_curve.toml")
    text = dembrick.dumps(scenario).replace('"convex"', '"concave"')
    run = dembrick.simulate(dembrick.loads(text), folder / "run.h5")
    page.write(folder / "run.h5", folder / "page.html")
    return run, folder / "page.html"
