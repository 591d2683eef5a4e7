"""Docstrings that editors show: every attribute of a public dataclass is described in its class."""

import dataclasses
import re

import pytest

import dembrick

CLASSES = [name for name in dembrick.__all__ if dataclasses.is_dataclass(getattr(dembrick, name))]


@pytest.mark.parametrize("name", CLASSES)
def test_every_attribute_of_a_dataclass_is_told_of(name):
    """The description is in its docstring or in that of a base class."""
    kind = getattr(dembrick, name)
    told = "\n".join(base.__doc__ or "" for base in kind.__mro__ if base is not object)
    public = [field.name for field in dataclasses.fields(kind) if not field.name.startswith("_")]
    assert not [one for one in public if not re.search(rf"``[^`]*\b{one}\b[^`]*``", told)]
