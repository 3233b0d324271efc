"""tools/vary_constants.py: a constant has another value in every module that takes it, and its own again afterwards."""

import importlib
import importlib.util
from pathlib import Path

import pytest

pytest.importorskip("rcdn_lab", reason="the laboratory isn't installed: pip install -e lab")
grow, rim, validate = (importlib.import_module(f"rcdn.boards.{name}") for name in ("grow", "rim", "validate"))
SPEC = importlib.util.spec_from_file_location("vary_constants", Path(__file__).parents[1] / "tools/vary_constants.py")
vary = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(vary)


def test_modules_that_take_a_constant_have_its_other_value():
    own = grow.SHOWN
    with vary.set_to(grow, "SHOWN", 7.0):
        assert grow.SHOWN == 7
        assert rim.SHOWN == 7
    assert own == grow.SHOWN
    assert own == rim.SHOWN


@pytest.mark.parametrize(
    ("value", "share", "other"), [(0.5, 0.8, 0.4), (10, 0.8, 8), (1, 1.25, 2), (2, 0.8, 1), (14, 1.25, 18)]
)
def test_values(value, share, other):
    assert vary.changed(value, share) == other


def test_another_value_changes_boards():
    """A board must fill more than its box, which none does."""
    factor, level = "square", "8"
    made = vary.picture(vary.FACTORS[factor][level], vary.seed_of(factor, level, 0))
    pictures = [("one", made.image, vary.Answers(made.boards, vary.bounds(made.scene)))]
    baseline, boards = vary.found(pictures, vary.DetectorConfig.auto(threads=1, target="plain"))
    assert baseline["success"] == 1
    assert [len(board) for board in boards["one"]] == [54]
    with vary.set_to(validate, "SMALL", ((100.0, 1.1),)):
        none, boards = vary.found(pictures, vary.DetectorConfig.auto(threads=1, target="plain"))
    assert none["recall"] == 0
    assert boards == {"one": []}
