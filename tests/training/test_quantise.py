"""8-bit weights are exported only if they answer as the network does."""

import json
import shutil
from dataclasses import replace
from importlib.resources import files

import pytest

from rcdn.corners.response import load_model
from rcdn.errors import RcdnError
from rcdn.training import quantise as module
from rcdn.training.quantise import BOUNDS, quantised, sidecar_text, store
from rcdn.validation import validation_set

WEIGHTS = files("rcdn") / "weights"


@pytest.fixture(autouse=True)
def few(monkeypatch):
    """Fewer pictures than at an export."""
    monkeypatch.setattr(module, "validation_set", lambda count: validation_set(8))


@pytest.fixture
def exported(tmp_path):
    """The shipped network, exported before 8-bit weights were stored."""
    shutil.copy(WEIGHTS / "rcdn_q.onnx", tmp_path / "q.onnx")
    facts = json.loads((WEIGHTS / "rcdn_q.json").read_text())
    del facts["quantised"]
    (tmp_path / "q.json").write_text(sidecar_text(facts))
    return tmp_path / "q.onnx"


def test_the_shipped_figures_are_within_the_bounds():
    figures = load_model("auto").facts["quantised"]
    assert figures["pictures"] == module.PICTURES
    assert all(0 < figures[name] <= most for name, most in BOUNDS.items())


def test_weights_are_stored_beside_an_exported_network(exported):
    before = json.loads(exported.with_suffix(".json").read_text())
    figures = store(exported)
    assert exported.with_suffix(".npz").read_bytes() == (WEIGHTS / "rcdn_q.npz").read_bytes()
    assert json.loads(exported.with_suffix(".json").read_text()) == before | {"quantised": figures}
    assert load_model(str(exported)).cells is not None
    assert store(exported) == figures  # and once more, with what is there already


def test_weights_that_answer_otherwise_are_kept_back(exported):
    """Ranges ten times as wide make whole numbers ten times as coarse."""
    facts = json.loads(exported.with_suffix(".json").read_text())
    facts["ranges"] = [[10 * v for v in values] for values in facts["ranges"]]
    exported.with_suffix(".json").write_text(json.dumps(facts))
    with pytest.raises(RcdnError, match=r"in 8 bits the network differs .* nothing was written"):
        store(exported)
    assert sorted(p.suffix for p in exported.parent.iterdir()) == [".json", ".onnx"]
    assert json.loads(exported.with_suffix(".json").read_text()) == facts


@pytest.mark.parametrize("name", BOUNDS)
@pytest.mark.parametrize("value", [0.2, float("nan")])
def test_each_bound_counts(monkeypatch, name, value):
    figures = dict.fromkeys(BOUNDS, 0.0) | {name: value}
    monkeypatch.setattr(module, "compare", lambda model: figures)
    with pytest.raises(RcdnError, match=name):
        quantised(load_model("auto"))


def test_networks_that_the_kernel_does_not_know_have_none():
    auto = load_model("auto", stored=False)
    assert quantised(load_model("paper")) is None
    assert quantised(replace(auto, facts=auto.facts | {"ranges": None})) is None


def test_other_files_are_refused(exported, tmp_path):
    (tmp_path / "a.txt").write_text("")
    for path in (tmp_path / "a.txt", tmp_path / "none.onnx", exported.with_suffix(".json")):
        with pytest.raises(RcdnError, match="neither the folder of a run nor an exported"):
            store(path)
    for ending in ("onnx", "json"):
        shutil.copy(WEIGHTS / f"rcdn_f.{ending}", tmp_path / f"f.{ending}")
    with pytest.raises(RcdnError, match="no cell network with 'ranges'"):
        store(tmp_path / "f.onnx")


def test_lists_of_numbers_take_a_line():
    facts = {"margins": [22, 23], "ranges": [[1.5, 2e-7], [-3.0]], "layers": ["a", "b"], "empty": []}
    text = sidecar_text(facts)
    assert json.loads(text) == facts
    assert ' "margins": [22, 23],\n' in text
    assert "  [1.5, 2e-07],\n" in text
