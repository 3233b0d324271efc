"""No public value with arrays is forgotten among those whose looks and copies are tested."""

import importlib
import re
import sys
from dataclasses import fields, is_dataclass

import pytest
from tests.test_objects import VALUES

pytestmark = pytest.mark.xdist_group("objects")  # they are made once
MODULES = ("types", "calibration", "calibration.guidance", "io")


def reachable():
    """The public value types, and those of their fields."""
    homes = [importlib.import_module(name) for name in ("rcdn", *(f"rcdn.{m}" for m in MODULES))]
    left = [v for home in homes for name in home.__all__ if is_dataclass(v := getattr(home, name))]
    found = set()
    while left:
        kind = left.pop()
        if kind not in found:
            found.add(kind)
            inside = [vars(sys.modules[kind.__module__]).get(name) for name in within(kind)]
            left += [v for v in inside if isinstance(v, type) and is_dataclass(v)]
    return found


def test_no_public_value_with_arrays_is_forgotten():
    holding = {kind for kind in reachable() if any("Array" in str(field.type) for field in fields(kind))}
    while more := {k for k in reachable() - holding if {h.__name__ for h in holding} & within(k)}:
        holding |= more
    assert len(holding) > 20
    assert holding <= {type(make()) for make in VALUES.values()}


def within(kind):
    """The names in the types of its fields."""
    return {name for field in fields(kind) for name in re.findall(r"\w+", str(field.type))}
