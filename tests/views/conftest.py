"""What tests of pictures ask for by name."""

import pytest

from dembrick.errors import MissingDependency
from dembrick.views.render import screen


@pytest.fixture
def drawing():
    """Skips on a machine that cannot draw."""
    try:
        screen.require_drawing()
    except MissingDependency as error:
        pytest.skip(str(error))
