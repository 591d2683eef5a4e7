"""What tests of pictures ask for by name."""

import pytest

import dembrick
from dembrick import history
from dembrick.errors import MissingDependency
from dembrick.scenario import shipped
from dembrick.views import page
from dembrick.views.render import screen
from helpers import history_cases as cases


@pytest.fixture
def drawing():
    """Skips on a machine that cannot draw."""
    try:
        screen.require_drawing()
    except MissingDependency as error:
        pytest.skip(str(error))


@pytest.fixture
def run(tmp_path):
    with history.HistoryWriter(
        tmp_path / "run.h5", cases.SCENARIO, cases.assembly(), {}, control=cases.CONSTANT_RATE
    ) as writer:
        writer.append(cases.record(0, 5))
        writer.append_frames(*cases.frames(0, 4))
        writer.finish("yield", {"title": "two blocks", "yield_point": {"torsion_centre": [-0.05, 0.0]}})
    with history.read(tmp_path / "run.h5") as found:
        yield found


@pytest.fixture(scope="session")
def lab_page(tmp_path_factory):
    """A real run, the constant-rate test of set 4b with corner points, and its page."""
    folder = tmp_path_factory.mktemp("page")
    scenario = dembrick.load(shipped.folder() / "set4b_curve.toml")
    text = dembrick.dumps(scenario).replace('"convex"', '"concave"')
    run = dembrick.simulate(dembrick.loads(text), folder / "run.h5")
    page.write(folder / "run.h5", folder / "page.html")
    return run, folder / "page.html"
