"""Export: ONNX Runtime answers as torch does; provenance; tiles, threads and tiny pictures change nothing."""

from __future__ import annotations

import dataclasses
import hashlib
import json

import pytest

pytest.importorskip("rcdn.training", exc_type=ImportError, reason="needs rcdn[train]")

import numpy as np
import onnx
import torch
from typer.testing import CliRunner

from rcdn.cli import app
from rcdn.corners.response import ResponseModel, load_model
from rcdn.errors import ConfigError, RcdnError
from rcdn.synthetic import random_crop
from rcdn.training import export as module
from rcdn.training import quantise
from rcdn.training.config import TrainConfig
from rcdn.training.export import export, folded, load_run, parity, provenance, to_onnx
from rcdn.training.loss import ACTIVATION
from rcdn.training.net import _of_onnx, build
from rcdn.training.samples import PoolConfig

KINDS = {"A": ("paper", "minmax"), "D-3": ("squared", "minmax"), "F": ("safe", "minmax"), "Q": ("heatmap", "local")}
CROP = random_crop(11, 112)[0][:97, :110]


def make_net(name):
    """Random weights, and batch norms with statistics that folding must not confuse."""
    torch.manual_seed(5)
    net = build(name)
    rng = np.random.default_rng(6)
    for module_ in net.modules():
        if isinstance(module_, torch.nn.BatchNorm2d):
            for tensor, low, high in (
                (module_.running_mean, -0.5, 0.5), (module_.running_var, 0.3, 2.0),
                (module_.weight.data, 0.5, 1.5), (module_.bias.data, -0.3, 0.3),
            ):  # fmt: skip
                tensor.copy_(torch.from_numpy(rng.uniform(low, high, tensor.shape)))
    torch.nn.init.constant_(net.blocks[-1][0].bias, 0.0 if name == "Q" else 0.5)  # away from where the response ends
    return net.eval()


def make_model(name):
    """(network, its ONNX bytes, what inference knows of it)."""
    net, (loss, kind) = make_net(name), KINDS[name]
    data = to_onnx(net, ACTIVATION[loss]).SerializeToString()
    side = 90 if name != "Q" else 93
    config = dataclasses.asdict(TrainConfig("x", name, loss, kind, side=side))
    return net, data, provenance({"config": config, "metrics": {}}, net, data)


def response_model(name):
    net, data, facts = make_model(name)
    arch = net.architecture
    return ResponseModel(data, facts["normalisation"], arch.margins, arch.cell, facts)


@pytest.mark.parametrize("name", KINDS)
def test_onnx_runtime_answers_as_torch_does(name):
    net, data, facts = make_model(name)
    assert parity(net, data, facts, CROP) <= 1e-5
    assert parity(net, data, facts) <= 1e-5
    response = response_model(name)(CROP)
    assert response.shape == CROP.shape
    assert response.std() > 1e-2  # not two nothings that agree


def test_parity_sees_a_wrong_weight():
    net, data, facts = make_model("A")
    with torch.no_grad():
        net.blocks[0][0].bias[0] += 0.01
    assert parity(net, data, facts, CROP) > 1e-4


def test_batch_norm_is_folded_in():
    block = make_net("Q").blocks[2]
    weight, bias = folded(block)
    image = torch.randn(1, 32, 9, 9, generator=torch.Generator().manual_seed(1))
    expected = block[1](block[0](image))
    got = torch.nn.functional.conv2d(image, weight, bias)
    assert torch.allclose(got, expected, atol=1e-5)


def test_the_graph_holds_nothing_but_convolutions():
    graph = onnx.load_from_string(make_model("Q")[1]).graph
    names = [node.op_type for node in graph.node]
    assert names == ["Conv", "Relu"] * 7 + ["Conv", "Sigmoid", "DepthToSpace"]
    graph = onnx.load_from_string(make_model("F")[1]).graph
    assert [n.op_type for n in graph.node] == ["Conv", "Relu"] * 5 + ["Conv", "Relu", "Identity"]
    size = sum(int(np.prod(t.dims)) for t in graph.initializer)
    assert size == 34_273


@pytest.fixture
def run_folder(tmp_path):
    """What a run of network A leaves."""
    config = TrainConfig("x", "A", "paper")
    folder = tmp_path / "x"
    folder.mkdir()
    report = {"config": dataclasses.asdict(config), "metrics": {"step": 3, "f1": 0.5}, "commit": "abc", "machine": "m"}
    (folder / "run.json").write_text(json.dumps(report))
    other = build("A")
    torch.save({"model": other.state_dict(), "ema": make_net("A").state_dict()}, folder / "last.pt")
    return folder


def test_what_is_written(run_folder, tmp_path):
    target = tmp_path / "out" / "net.onnx"
    facts, gap = export(run_folder, target)
    assert 0 <= gap <= 1e-5
    assert sorted(p.name for p in target.parent.iterdir()) == ["net.json", "net.onnx"]
    assert json.loads(target.with_suffix(".json").read_text()) == facts
    assert facts["sha256"] == hashlib.sha256(target.read_bytes()).hexdigest()
    assert (facts["architecture"], facts["layers"]) == ("A", ["13-16", "1-8", "3-1"])
    assert (facts["parameters"], facts["mac_per_pixel"], facts["margins"], facts["cell"]) == (2929, 2904, [7, 7], 1)
    assert (facts["commit"], facts["machine"], facts["training"]["seed"]) == ("abc", "m", 1)
    averaged = response_model("A")
    assert np.array_equal(load_model(str(target))(CROP), averaged(CROP))  # the average, not the last weights
    export(run_folder, tmp_path / "again.onnx")
    assert (tmp_path / "again.onnx").read_bytes() == target.read_bytes()


def test_the_curve_of_a_run_is_beside_its_weights(run_folder, tmp_path):
    (run_folder / "metrics.csv").write_text("step,loss,seconds,f1\n2,0.75,1.5,0.25\n3,0.5,2.5,0.5\n")
    facts, _ = export(run_folder, tmp_path / "net.onnx")
    assert facts["curve"] == [[2, 0.75, 0.25], [3, 0.5, 0.5]]


@pytest.fixture
def grown_runs(tmp_path, monkeypatch):
    """Three runs of network A that grew from one network, with other weights each; no validation."""
    monkeypatch.setattr(module, "validate", lambda net, config: {"f1": float(config.seed)})
    folders = []
    for seed in (1, 2, 3):
        torch.manual_seed(seed)
        folder = tmp_path / f"run{seed}"
        folder.mkdir()
        config = TrainConfig("x", "A", "safe", teacher="e", seed=seed, background=float(seed))
        report = {"config": dataclasses.asdict(config), "metrics": {"step": 3, "f1": 0.5 + seed}, "commit": f"c{seed}"}
        (folder / "run.json").write_text(json.dumps(report | {"machine": "m"}))
        state = build("A").state_dict()
        torch.save({"model": state, "ema": state}, folder / "last.pt")
        folders.append(folder)
    return folders


def test_several_runs_give_the_mean_of_their_weights(grown_runs, tmp_path):
    facts, _ = export(grown_runs, tmp_path / "mean.onnx")
    states = [torch.load(f / "last.pt", weights_only=True)["ema"] for f in grown_runs]
    for name, values in _of_onnx(tmp_path / "mean.onnx").items():
        np.testing.assert_allclose(values, sum(s[name] for s in states) / 3, rtol=1e-6, atol=1e-8)
    assert facts["metrics"] == {"step": 3, "f1": 1.0}  # of the mean
    assert [(r["seed"], r["background"], r["commit"], r["metrics"]["f1"]) for r in facts["runs"]] == [
        (1, 1.0, "c1", 1.5),
        (2, 2.0, "c2", 2.5),
        (3, 3.0, "c3", 3.5),
    ]
    assert export(grown_runs[:1], tmp_path / "one.onnx")[0]["metrics"]["f1"] == 1.5


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"architecture": "D"}, "one architecture, not A, D"),
        ({"teacher": "other"}, "one teacher, not e, other"),
        ({"normalisation": "local"}, "one normalisation"),
        ({"pool": dataclasses.asdict(PoolConfig(ranges="deltille"))}, "one pool.ranges"),
    ],
)
def test_runs_that_have_no_mean_are_refused(grown_runs, tmp_path, change, text):
    report = json.loads((grown_runs[1] / "run.json").read_text())
    report["config"] |= change
    (grown_runs[1] / "run.json").write_text(json.dumps(report))
    if "architecture" in change:
        torch.save({"ema": build("D").state_dict()}, grown_runs[1] / "last.pt")
    with pytest.raises(ConfigError, match=text):
        export(grown_runs, tmp_path / "mean.onnx")


def test_a_run_counts_once(grown_runs, tmp_path):
    with pytest.raises(ConfigError, match="named twice"):
        export([grown_runs[0], grown_runs[1], grown_runs[0]], tmp_path / "mean.onnx")


def test_the_mean_needs_a_name(grown_runs):
    result = CliRunner().invoke(app, ["export", *map(str, grown_runs)])
    assert result.exit_code == 2
    assert "--output" in result.stderr
    target = grown_runs[0].parent / "mean.onnx"
    result = CliRunner().invoke(app, ["export", *map(str, grown_runs), "-o", str(target)])
    assert result.exit_code == 0, result.output
    assert "the mean of the weights of 3 runs" in result.stdout
    result = CliRunner().invoke(app, ["export", str(grown_runs[0]), str(target)])
    assert result.exit_code == 2
    assert "from the folders of their runs" in result.stderr


@pytest.mark.parametrize(
    ("change", "text"), [({"teacher": ""}, "grew from one"), ({"batch_norm": True}, "without batch")]
)
@pytest.mark.parametrize("which", [slice(None), slice(1, 2)])
def test_runs_from_nothing_or_with_statistics_have_no_mean(grown_runs, tmp_path, change, text, which):
    text = "one teacher" if "teacher" in change and which != slice(None) else text
    for folder in grown_runs[which]:
        report = json.loads((folder / "run.json").read_text())
        report["config"] |= change
        (folder / "run.json").write_text(json.dumps(report))
        if "batch_norm" in change:
            torch.save({"ema": build("A", True).state_dict()}, folder / "last.pt")
    with pytest.raises(ConfigError, match=text):
        export(grown_runs, tmp_path / "mean.onnx")


@pytest.mark.parametrize("gap", [2e-4, float("nan")])
def test_nothing_is_written_without_parity(run_folder, tmp_path, monkeypatch, gap):
    target = tmp_path / "net.onnx"
    target.write_bytes(b"old")
    monkeypatch.setattr(module, "parity", lambda *args: gap)
    with pytest.raises(RcdnError, match="nothing was written"):
        export(run_folder, target)
    assert target.read_bytes() == b"old"
    assert not target.with_suffix(".json").exists()


@pytest.fixture
def cell_run(run_folder, monkeypatch):
    """The same of a cell network, with ranges at once; and what its 8-bit weights change, to be set."""
    config = TrainConfig("x", "Q", "heatmap", "local", side=93)
    report = json.loads((run_folder / "run.json").read_text()) | {"config": dataclasses.asdict(config)}
    (run_folder / "run.json").write_text(json.dumps(report))
    state = make_net("Q").state_dict()
    torch.save({"model": state, "ema": state}, run_folder / "last.pt")
    monkeypatch.setattr(module, "ranges", lambda *args: [[5.0] * 16, *[[5.0] * 32] * 6])
    figures = dict.fromkeys(quantise.BOUNDS, 0.001)
    monkeypatch.setattr(quantise, "compare", lambda model: figures)
    return run_folder, figures


def test_a_cell_network_gets_its_8_bit_weights(cell_run, tmp_path):
    target = tmp_path / "out" / "q.onnx"
    facts, _ = export(cell_run[0], target)
    assert sorted(p.name for p in target.parent.iterdir()) == ["q.json", "q.npz", "q.onnx"]
    assert json.loads(target.with_suffix(".json").read_text()) == facts
    loaded = load_model(str(target))
    assert hashlib.sha256(target.with_suffix(".npz").read_bytes()).hexdigest() == facts["quantised"]["sha256"]
    assert loaded.cells is not None


def test_a_cell_network_whose_8_bit_weights_fail_is_not_written(cell_run, tmp_path):
    cell_run[1]["largest difference"] = 0.3
    with pytest.raises(RcdnError, match=r"largest difference .* nothing was written"):
        export(cell_run[0], tmp_path / "out" / "q.onnx")
    assert not (tmp_path / "out").exists()


def test_names_and_folders_that_are_refused(run_folder, tmp_path):
    with pytest.raises(ConfigError, match=r"must end in \.onnx"):
        export(run_folder, tmp_path / "net.json")
    report = json.loads((run_folder / "run.json").read_text())
    report["config"]["architecture"] = "F"
    (run_folder / "run.json").write_text(json.dumps(report))
    with pytest.raises(RcdnError, match=r"last\.pt holds no weights .* that fit"):
        load_run(run_folder)
    for text in ("{", '{"metrics": 1}'):
        (run_folder / "run.json").write_text(text)
        with pytest.raises(RcdnError, match=r"not the folder of a run of `rcdn train`"):
            load_run(run_folder)


SIZES = [(1, 1), (3, 200), (200, 3), (7, 7), (65, 129), (128, 190)]


@pytest.fixture(scope="module", params=["A", "Q"])
def model(request):
    return response_model(request.param)


@pytest.mark.parametrize("size", SIZES)
def test_tiles_give_what_the_whole_gives(model, size):
    """A picture in tiles of 64 px, whole, and by one thread or two."""
    grey = np.random.default_rng(3).integers(0, 256, size, dtype=np.uint8)
    whole = model(grey, threads=1, tile=512)
    assert whole.shape == size
    assert whole.dtype == np.float32
    assert np.isfinite(whole).all()
    assert (whole >= 0).all()
    tiled = model(grey, threads=1, tile=64)
    assert np.abs(tiled - whole).max() <= 1e-5
    assert model(grey, threads=2, tile=64).tobytes() == tiled.tobytes()


def test_the_border_is_continued_by_reflection(model):
    """The inside of a picture that was reflected by hand has the same response."""
    grey = np.random.default_rng(4).integers(0, 256, (96, 104), dtype=np.uint8)
    if model.normalisation == "minmax":
        grey[::2, ::2], grey[1::2, 1::2] = 0, 255  # the same percentiles with and without the border
    grown = model(np.pad(grey, 48, mode="reflect"))[48:-48, 48:-48]
    assert np.abs(grown - model(grey)).max() <= 1e-4
