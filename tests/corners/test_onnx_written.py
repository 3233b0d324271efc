"""8-bit weights as an ONNX file: what a GPU runs are the weights that the compiled kernel runs."""

import shutil
import tomllib
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from rcdn.corners.cells import CellNetwork
from rcdn.corners.onnx_file import read_graph
from rcdn.corners.onnx_written import to_onnx
from rcdn.corners.quantised import to_npz
from rcdn.corners.response import PROVIDERS, load_model
from rcdn.errors import RcdnError
from rcdn.synthetic import PRESETS, random_crop

WEIGHTS = files("rcdn") / "weights"
PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())


@pytest.fixture(scope="module")
def auto():
    return load_model("auto")


def test_the_way_there_and_back_gives_the_same_bytes(auto):
    again = CellNetwork.of(read_graph(auto.onnx), auto.facts["ranges"])
    assert to_npz(again) == (WEIGHTS / "rcdn_q.npz").read_bytes()


def test_it_is_an_onnx_file_like_that_of_training(auto):
    onnx = pytest.importorskip("onnx", reason="compares with the package onnx")
    made, trained = (onnx.load_from_string(data) for data in (auto.onnx, (WEIGHTS / "rcdn_q.onnx").read_bytes()))
    onnx.checker.check_model(made, full_check=True)
    assert [(op.domain, op.version) for op in made.opset_import] == [
        (op.domain, op.version) for op in trained.opset_import
    ]
    for mine, theirs in zip(made.graph.node, trained.graph.node, strict=True):
        assert (mine.op_type, list(mine.attribute)) == (theirs.op_type, list(theirs.attribute))
    for mine, theirs in zip(made.graph.initializer, trained.graph.initializer, strict=True):
        ours, known = onnx.numpy_helper.to_array(mine), onnx.numpy_helper.to_array(theirs)
        assert np.abs(ours - known).max() <= np.abs(known).max() / 50


def test_it_answers_nearer_to_the_kernel_than_the_network_before_8_bits_does(auto):
    trained, near, far = load_model("auto", stored=False), [], []
    for seed in range(6):
        grey = random_crop(700 + seed, 140, PRESETS["training"])[0]
        known, whole = trained.by_onnx_runtime(grey, 1), auto(grey, 1)
        near.append(np.abs(auto.by_onnx_runtime(grey, 1) - whole)[known > 0.3])
        far.append(np.abs(known - whole)[known > 0.3])
    assert np.concatenate(near).mean() < 0.7 * np.concatenate(far).mean() < 0.005


@pytest.mark.parametrize("device", ["cpu", "cuda"])
def test_a_network_needs_no_onnx_file_beside_its_8_bit_weights(auto, tmp_path, monkeypatch, device):
    monkeypatch.setitem(PROVIDERS, "cuda", "CPUExecutionProvider")
    for ending in ("npz", "json"):
        shutil.copy(WEIGHTS / f"rcdn_q.{ending}", tmp_path / f"own.{ending}")
    model = load_model(str(tmp_path / "own.onnx"), device)
    grey = random_crop(3, 120, PRESETS["ordinary"])[0]
    known = auto(grey, 1) if device == "cpu" else auto.by_onnx_runtime(grey, 1)
    assert np.abs(model(grey, 1) - known).max() <= (0 if device == "cpu" else 1e-5)
    with pytest.raises(RcdnError, match="no weights"):
        load_model(str(tmp_path / "own.onnx"), stored=False)


def test_ranges_that_are_missing_or_others_are_told(auto):
    with pytest.raises(RcdnError, match=r"holds no 'ranges'.*rcdn export"):
        _ = replace(auto, facts={}).onnx
    with pytest.raises(RcdnError, match="'ranges' must hold a number for each output"):
        to_onnx(auto.quantised, [[1.0]])


def test_the_wheel_holds_the_weights_that_run_and_no_second_form_of_them():
    patterns = PROJECT["tool"]["setuptools"]["package-data"]["rcdn"]
    shipped = {
        path.name
        for pattern in patterns
        if not pattern.startswith(("live/", "report/"))
        for path in Path(str(files("rcdn"))).glob(pattern)
    }
    names = ("rcdn_deltille.json", "rcdn_deltille.onnx", "rcdn_f.json", "rcdn_f.onnx", "rcdn_q.json", "rcdn_q.npz")
    assert shipped == {"py.typed", *names}
