"""The loop: it learns, it goes on after a kill as if nothing had happened, it says when a network is dead."""

from __future__ import annotations

import csv
import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rcdn.training", exc_type=ImportError, reason="needs rcdn[train]")

import cv2
import numpy as np
import torch
from lightning_fabric import Fabric

from rcdn.corners.onnx_file import read_graph
from rcdn.errors import ConfigError, OutputError, RcdnError
from rcdn.training import alone, loop, quantise, steps, validate
from rcdn.training import export as exporting
from rcdn.training.config import TrainConfig, read_config
from rcdn.training.export import export
from rcdn.training.loop import train
from rcdn.training.samples import PoolConfig
from rcdn.training.steps import DeadNetError, Run

POOL = PoolConfig(count=6, size=64, ranges="ordinary", seed=4)
A = TrainConfig("a", "A", side=54, batch=4, steps=6, validate_every=2, rate=0.02, pool=POOL)
Q = dataclasses.replace(
    A, name="q", architecture="Q", loss="heatmap", normalisation="local", optimiser="adamw", side=61
)


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Two crops to validate on, one thread."""
    crops = validate.validation_set.__wrapped__(2)
    monkeypatch.setattr(validate, "validation_set", lambda: crops)
    before = torch.get_num_threads(), cv2.getNumThreads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before[0])
    cv2.setNumThreads(before[1])


def run(config, runs, **kw):
    fabric = Fabric(accelerator="cpu", devices=1)
    return train(config, runs, workers=0, fabric=fabric, **kw)


def weights(folder, kind="model"):
    return torch.load(folder / "last.pt", weights_only=True)[kind]


def rows(folder):
    with (folder / "metrics.csv").open() as file:
        return list(csv.DictReader(file))


def same(a, b):
    return a.keys() == b.keys() and all(torch.equal(a[k], b[k]) for k in a)


class Killed(Exception):
    pass


def kill_at(monkeypatch, step):
    """The process dies in that step, after its last checkpoint."""
    original = Run.step

    def stepping(self, image, goal):
        if self.state["step"] == step:
            raise Killed
        original(self, image, goal)

    monkeypatch.setattr(Run, "step", stepping)
    return lambda: monkeypatch.setattr(Run, "step", original)


@pytest.mark.parametrize("config", [A, Q, dataclasses.replace(Q, mined=2)], ids=["A", "Q", "mined"])
def test_a_killed_run_goes_on_as_if_nothing_had_happened(tmp_path, monkeypatch, config, capsys):
    whole = run(config, tmp_path / "whole")
    revive = kill_at(monkeypatch, 5)
    with pytest.raises(Killed):
        run(config, tmp_path / "killed")
    revive()
    folder = run(config, tmp_path / "killed")
    for kind in ("model", "ema"):
        assert same(weights(folder, kind), weights(whole, kind))
    assert not same(weights(whole, "model"), weights(whole, "ema"))
    keep = ("step", "loss", "positive", "f1")
    assert [[r[k] for k in keep] for r in rows(folder)] == [[r[k] for k in keep] for r in rows(whole)]
    assert "\x1b" not in "".join(capsys.readouterr())  # no progress bar in a pipe


def test_what_a_run_leaves(tmp_path, capsys):
    folder = run(A, tmp_path)
    assert folder == tmp_path / "a"
    assert sorted(p.name for p in folder.iterdir()) == ["events", "last.pt", "metrics.csv", "run.json"]
    assert [r["step"] for r in rows(folder)] == ["2", "4", "6"]
    assert list((folder / "events").glob("events.out.tfevents.*"))
    report = json.loads((folder / "run.json").read_text())
    assert report["config"] == dataclasses.asdict(A)
    assert report["metrics"]["step"] == 6
    assert {"loss", "f1", "ap", "pixel_error", "seconds"} < report["metrics"].keys()
    assert report["commit"] == "unknown" or len(report["commit"].rstrip("+")) == 40
    out, err = capsys.readouterr()
    assert out.splitlines()[0] == "rendering pool: 1/1"
    assert out.count("\n") == 4
    assert err == ""
    run(A, tmp_path)  # complete: nothing more happens
    assert len(rows(folder)) == 3


def test_what_was_logged_after_the_last_checkpoint_is_logged_once(tmp_path, monkeypatch):
    """Killed between the log and the checkpoint of step 4."""
    saves = []

    def save(self, *args):
        saves.append(args)
        if len(saves) == 2:
            raise Killed
        original(self, *args)

    original = Fabric.save
    monkeypatch.setattr(Fabric, "save", save)
    with pytest.raises(Killed):
        run(A, tmp_path)
    assert [r["step"] for r in rows(tmp_path / "a")] == ["2", "4"]
    folder = run(A, tmp_path)
    assert [r["step"] for r in rows(folder)] == ["2", "4", "6"]


@pytest.mark.skipif(alone.fcntl is None, reason="no locks of POSIX")
def test_two_processes_do_not_train_in_one_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(alone, "WAITS", 1)
    folder = tmp_path / "runs" / "tiny"
    there = pytest.raises(ConfigError, match="another process trains there")
    with alone.alone(folder), there, alone.alone(folder):
        pass
    with alone.alone(folder):
        pass


def test_a_full_disk_is_one_line_and_leaves_the_last_checkpoint(tmp_path, monkeypatch):
    saves = []

    def save(self, path, state):
        saves.append(path)
        if len(saves) == 2:
            path.write_bytes(b"half")
            raise RuntimeError("[enforce fail at inline_container.cc:659] . unexpected pos 64 vs 0")
        original(self, path, state)

    original = Fabric.save
    monkeypatch.setattr(Fabric, "save", save)
    with pytest.raises(OutputError, match=r"new.pt: can't be written: .*; make room"):
        run(A, tmp_path)
    assert torch.load(tmp_path / "a" / "last.pt", weights_only=True)["step"] == 2
    assert not (tmp_path / "a" / "new.pt").exists()


@pytest.mark.filterwarnings("ignore:.*use of fork:DeprecationWarning")  # torch's loader forks; Python 3.12 warns
def test_workers_change_nothing(tmp_path):
    alone, fabric = run(A, tmp_path / "alone"), Fabric(accelerator="cpu", devices=1)
    assert same(weights(train(A, tmp_path / "helped", workers=2, fabric=fabric)), weights(alone))


def test_the_learning_rate_falls_to_a_hundredth(tmp_path):
    folder = run(A, tmp_path)
    assert weights(folder, "optimiser")["param_groups"][0]["lr"] == pytest.approx(0.01 * A.rate)
    assert weights(folder, "optimiser")["param_groups"][0]["momentum"] == 0.9


def test_other_settings_do_not_go_on_with_an_old_run(tmp_path):
    folder = run(A, tmp_path)
    before = weights(folder)
    other = dataclasses.replace(A, seed=2, rate=0.01)
    with pytest.raises(ConfigError, match=r"other settings \(rate, seed\).*--fresh"):
        run(other, tmp_path)
    run(dataclasses.replace(A, validate_every=3), tmp_path)
    assert same(weights(folder), before)
    run(other, tmp_path, resume=False)
    assert not same(weights(folder), before)
    assert [r["step"] for r in rows(folder)] == ["2", "4", "6"]
    assert len(list((folder / "events").iterdir())) == 1


def test_a_run_begins_from_the_weights_of_another(tmp_path):
    first = run(A, tmp_path)
    follower = dataclasses.replace(A, name="b", start=str(first / "last.pt"), rate=1e-12, decay=0.0)
    second = run(follower, tmp_path)
    expected = weights(first, "ema")
    assert all(torch.allclose(v, expected[k], atol=1e-9) for k, v in weights(second).items())
    (tmp_path / "text.pt").write_text("no checkpoint")
    for start, architecture in ((tmp_path / "none.pt", "A"), (tmp_path / "text.pt", "A"), (first / "last.pt", "B")):
        with pytest.raises(RcdnError, match=r"no weights of `rcdn train` that fit"):
            run(dataclasses.replace(follower, name="c", architecture=architecture, start=str(start)), tmp_path)


def test_a_run_weighs_the_background_as_its_configuration_says(tmp_path):
    """The first step's loss is linear in the weight: corners + weight · background."""
    one, two, four = (
        float(rows(run(dataclasses.replace(A, name=f"w{w:g}", steps=1, background=w), tmp_path))[0]["loss"])
        for w in (1.0, 2.0, 4.0)
    )
    assert two - one > 0.01
    assert four - one == pytest.approx(3 * (two - one), abs=1e-5)


@pytest.mark.parametrize("config", [A, Q], ids=["A", "Q"])
def test_a_run_begins_from_an_exported_network(config, tmp_path, monkeypatch):
    """With a rate of nearly nothing it computes what the exported one computes."""
    monkeypatch.setattr(quantise, "BOUNDS", {})  # six steps of training don't make a network that 8 bits suit
    monkeypatch.setattr(exporting, "PICTURES", 8)  # for the ranges of these 8 bits
    first = run(config, tmp_path)
    export(first, tmp_path / "old.onnx")
    follower = dataclasses.replace(config, name="b", start=str(tmp_path / "old.onnx"), rate=1e-12, decay=0.0, seed=9)
    export(run(follower, tmp_path), tmp_path / "new.onnx")
    old, new = (read_graph((tmp_path / name).read_bytes()).tensors for name in ("old.onnx", "new.onnx"))
    assert old.keys() == new.keys()
    assert all(np.allclose(old[k], new[k], atol=1e-9) for k in old)
    (tmp_path / "none.onnx").write_bytes(b"nothing")
    for start, architecture in (("none", config.architecture), ("nowhere", config.architecture), ("old", "B")):
        wrong = dataclasses.replace(
            follower, name="c", architecture=architecture, side=61, start=str(tmp_path / f"{start}.onnx")
        )
        with pytest.raises(RcdnError, match=r"no weights of `rcdn train` that fit"):
            run(wrong, tmp_path)
    with pytest.raises(ConfigError, match="has no `batch_norm`"):
        dataclasses.replace(follower, batch_norm=True)


def test_a_few_crops_are_learnt_by_heart(tmp_path, monkeypatch):
    monkeypatch.setattr(validate, "validation_set", None)  # the crops themselves are validated on
    many = dataclasses.replace(POOL, count=10**6)  # of which two are rendered
    config = dataclasses.replace(Q, rate=0.01, steps=400, validate_every=100, pool=many)
    folder = run(config, tmp_path, overfit=2)
    assert folder.name == "q-overfit"
    log = [(float(r["loss"]), float(r["f1"])) for r in rows(folder)]
    assert log[-1][0] < 0.15 * log[0][0]
    assert log[-1][1] > 0.8


def test_the_alarm_of_a_dead_network(tmp_path, monkeypatch):
    """Eq. 1 as it stands gives no gradient where the response is zero."""
    monkeypatch.setattr(steps, "DEAD_AFTER", 4)
    original = loop.build

    def dead(name, batch_norm=False, start=""):
        net = original(name)
        torch.nn.init.constant_(net.blocks[-1][0].bias, -100.0)
        return net

    monkeypatch.setattr(loop, "build", dead)
    with pytest.raises(DeadNetError, match=r'no response .* 4 steps \(loss 13\.8.*loss = "safe"'):
        run(dataclasses.replace(A, loss="paper"), tmp_path)
    monkeypatch.setattr(steps, "DEAD_AFTER", 7)
    run(dataclasses.replace(A, loss="paper"), tmp_path)  # six steps: no alarm yet


def test_batches_without_corners_say_nothing_of_a_death(tmp_path, monkeypatch):
    monkeypatch.setattr(steps, "DEAD_AFTER", 1)
    original = loop.cut

    def empty(*args):
        image, goal = original(*args)
        return image, goal._replace(positive=torch.zeros_like(goal.positive))

    monkeypatch.setattr(loop, "cut", empty)
    folder = run(A, tmp_path)
    assert rows(folder)[-1]["positive"] == "0.0"


def test_a_network_without_any_hit_is_reported(tmp_path):
    """No distance to average: NaN in the table, null in the JSON, no warning."""
    folder = run(dataclasses.replace(Q, steps=1), tmp_path)
    assert rows(folder)[0]["pixel_error"] == "nan"
    assert json.loads((folder / "run.json").read_text())["metrics"]["pixel_error"] is None


TWO = """
import sys
from pathlib import Path
import torch
from lightning_fabric import Fabric
from rcdn.training import validate
from rcdn.training.config import TrainConfig
from rcdn.training.loop import train
from rcdn.training.samples import PoolConfig

if __name__ == "__main__":
    torch.set_num_threads(1)
    crops = validate.validation_set(2)
    validate.validation_set = lambda: crops
    pool = PoolConfig(count=6, size=64, ranges="ordinary", seed=4)
    kind = dict(architecture="Q", loss="heatmap", normalisation="local", optimiser="adamw", side=61)
    config = TrainConfig("two", batch=2, steps=3, validate_every=3, pool=pool, **kind)
    fabric = Fabric(accelerator="cpu", devices=2, strategy="ddp")
    train(config, Path(sys.argv[1]), workers=0, fabric=fabric)
    print(f"rank {fabric.global_rank} of {fabric.world_size} done", flush=True)
"""


def test_two_processes(tmp_path):
    script = tmp_path / "two.py"
    script.write_text(TWO)
    env = {k: v for k, v in os.environ.items() if k not in ("LOCAL_RANK", "RANK", "WORLD_SIZE")}
    done = subprocess.run(
        [sys.executable, str(script), str(tmp_path / "runs")],
        capture_output=True, text=True, timeout=120, cwd=Path(__file__).parent, env=env | {"OMP_NUM_THREADS": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    for rank in (0, 1):
        assert f"rank {rank} of 2 done" in done.stdout
    folder = tmp_path / "runs" / "two"
    assert [r["step"] for r in rows(folder)] == ["3"]
    state = torch.load(folder / "last.pt", weights_only=True)
    assert state["step"] == 3
    assert all(not key.startswith("module.") for key in state["model"])  # loads on one device


def test_configurations_in_the_repository():
    for path in sorted(Path(__file__).parents[2].glob("configs/**/*.toml")):
        config = read_config(path)
        assert config.name == path.stem


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("steps = 'many'", "steps must be of type int"),
        ("stepz = 3", "unknown key 'stepz'"),
        ("[pool]\ncuont = 3", r"unknown key 'pool\.cuont'"),
        ("pool = 3", "pool must be a table"),
        ("name = 3", "name must be of type str"),
        ("architecture = 'Z'", "architecture must be one of"),
        ("loss = 'l2'", "loss must be one of"),
        ("optimiser = 'lion'", "optimiser must be one of"),
        ("normalisation = 'none'", "normalisation must be one of"),
        ("steps = 0", r"steps must be in \[1, "),
        ("rate = 0", "rate must be above 0"),
        ("background = 0", "background must be in"),
        ("loss = 'heatmap'\nbackground = 2", "background: the loss 'heatmap' has no weight of the background"),
        ("ema = 1.0", "ema below 1"),
        ("side = 200", "side must be .* at most pool.size = 112"),
        ("side = 18", "side must be 18 plus"),
        ("architecture = 'Q'\nside = 110", "45 plus a multiple of 4"),
        ("steps = ", "is not TOML"),
    ],
)
def test_wrong_configurations(tmp_path, text, message):
    path = tmp_path / "c.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message):
        read_config(path)


def test_a_configuration_that_is_not_there(tmp_path):
    with pytest.raises(ConfigError, match=r"none\.toml: no such file"):
        read_config(tmp_path / "none.toml")


def test_whole_numbers_stand_for_floats(tmp_path):
    path = tmp_path / "fine.toml"
    path.write_text("clip = 1\n[pool]\ncount = 10")
    config = read_config(path)
    assert config == TrainConfig("fine", clip=1.0, pool=PoolConfig(count=10))
    assert type(config.clip) is float


B = dataclasses.replace(A, name="b", architecture="B", teacher="a", frozen=3)


def test_a_network_grows_from_its_teacher_new_layers_first(tmp_path, monkeypatch):
    teacher = weights(run(A, tmp_path), "ema")
    revive = kill_at(monkeypatch, 3)
    with pytest.raises(Killed):
        run(dataclasses.replace(B, validate_every=3), tmp_path)
    revive()
    before = weights(tmp_path / "b")
    shared = [f"blocks.{k}.0.{what}" for k in (0, 1) for what in ("weight", "bias")]
    assert all(torch.equal(before[key], teacher[key]) for key in shared)
    assert not torch.equal(before["blocks.3.0.weight"], torch.full_like(before["blocks.3.0.weight"], 1 / 16))
    after = weights(run(dataclasses.replace(B, validate_every=3), tmp_path))
    assert not any(torch.equal(after[key], teacher[key]) for key in shared)


def test_a_teacher_must_be_there_and_finished(tmp_path, monkeypatch):
    with pytest.raises(RcdnError, match="is not the folder of a run"):
        run(B, tmp_path)
    revive = kill_at(monkeypatch, 5)
    with pytest.raises(Killed):
        run(A, tmp_path)
    revive()
    with pytest.raises(ConfigError, match="has 4 of its 6 steps"):
        run(B, tmp_path)


def test_a_teacher_excludes_a_start_and_a_batch_norm():
    for change in ({"start": "x.pt"}, {"batch_norm": True}):
        with pytest.raises(ConfigError, match="teacher"):
            dataclasses.replace(B, **change)


def test_a_recipe_gives_what_the_file_does_not_say(tmp_path):
    (tmp_path / "recipe.toml").write_text("rate = 0.5\nsteps = 7\n[pool]\ncount = 9\n")
    (tmp_path / "net.toml").write_text('recipe = "recipe.toml"\narchitecture = "A"\nsteps = 3\n')
    config = read_config(tmp_path / "net.toml")
    assert (config.name, config.architecture, config.rate, config.steps, config.pool.count) == ("net", "A", 0.5, 3, 9)
    (tmp_path / "net.toml").write_text('recipe = "gone.toml"\n')
    with pytest.raises(ConfigError, match=r"gone\.toml: no such file"):
        read_config(tmp_path / "net.toml")
    (tmp_path / "net.toml").write_text("recipe = 3\n")
    with pytest.raises(ConfigError, match="recipe must be the name of a file"):
        read_config(tmp_path / "net.toml")


def test_a_recipe_may_have_a_recipe(tmp_path):
    (tmp_path / "inner").mkdir()
    (tmp_path / "all.toml").write_text("rate = 0.5\nsteps = 7\nseed = 4\n[pool]\ncount = 9\n")
    (tmp_path / "some.toml").write_text('recipe = "all.toml"\nsteps = 3\nseed = 5\n')
    (tmp_path / "inner" / "net.toml").write_text('recipe = "../some.toml"\narchitecture = "A"\nseed = 6\n')
    config = read_config(tmp_path / "inner" / "net.toml")
    assert (config.rate, config.steps, config.seed, config.pool.count) == (0.5, 3, 6, 9)
    (tmp_path / "all.toml").write_text('recipe = "some.toml"\n')
    with pytest.raises(ConfigError, match="a recipe of its own recipe"):
        read_config(tmp_path / "inner" / "net.toml")


@pytest.mark.parametrize("key", ["name", "teacher"])
@pytest.mark.parametrize("bad", ["../a", "..", ".", "/tmp/a", "a/b", "a\\b", "c:a", "a\nb", "a\0b", "a" * 200])
def test_a_name_stays_in_the_folder_of_runs(key, bad):
    with pytest.raises(ConfigError, match=rf"config: {key} must be the bare name of a folder"):
        dataclasses.replace(A, **{key: bad})


def test_an_empty_name():
    with pytest.raises(ConfigError, match="config: name must be the bare name"):
        dataclasses.replace(A, name="")


class _Runs:
    """What a pickle does on being read."""

    def __init__(self, file):
        self.file = file

    def __reduce__(self):
        return (Path.touch, (self.file,))


def test_a_checkpoint_may_hold_no_code(tmp_path):
    folder = run(dataclasses.replace(A, steps=2), tmp_path)
    ran = tmp_path / "ran"
    state = torch.load(folder / "last.pt", weights_only=True)
    torch.save(state | {"schedule": _Runs(ran)}, folder / "last.pt")
    with pytest.raises(RcdnError, match=r"last\.pt is no checkpoint of `rcdn train` that fits: .*--fresh"):
        run(dataclasses.replace(A, steps=2), tmp_path)
    assert not ran.exists()
    (folder / "last.pt").write_bytes(b"no checkpoint at all")
    with pytest.raises(RcdnError, match="is no checkpoint"):
        run(dataclasses.replace(A, steps=2), tmp_path)
