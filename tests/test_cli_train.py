"""`rcdn train` and `rcdn export`: what they do with their options, what they say, how they end."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2
import pytest
from typer.testing import CliRunner

from rcdn.cli import app

CONFIG = """
architecture = "A"
side = 54
batch = 3
steps = 2
validate_every = 2
[pool]
count = 4
size = 64
ranges = "ordinary"
backgrounds = "photographs"
"""


@pytest.fixture
def torch():
    return pytest.importorskip("torch", reason="needs rcdn[train]")


@pytest.fixture
def run(monkeypatch, tmp_path, torch):
    """Run `rcdn ARGUMENTS` in a folder with tiny.toml."""
    from rcdn.training import validate

    crops = validate.validation_set.__wrapped__(2)
    monkeypatch.setattr(validate, "validation_set", lambda: crops)
    monkeypatch.chdir(tmp_path)
    Path("tiny.toml").write_text(CONFIG)
    before = torch.get_num_threads(), cv2.getNumThreads()

    def go(*arguments):
        return CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)

    yield go
    torch.set_num_threads(before[0])
    cv2.setNumThreads(before[1])


CPU = ("--threads", 1, "--workers", 0, "--accelerator", "cpu", "--devices", 1)


def report(folder="runs/tiny"):
    return json.loads(Path(folder, "run.json").read_text())


def test_train_then_export(run, torch):
    result = run("train", "tiny.toml", "--backgrounds", "none", *CPU)
    assert result.exit_code == 0
    assert result.stderr == ""  # no progress bar in a pipe
    assert "step 2, loss" in result.stdout
    assert result.stdout.splitlines()[-1].startswith("runs/tiny is complete; its weights: rcdn export runs/tiny")
    assert torch.get_num_threads() == 1
    result = run("export", "runs/tiny", "-o", "weights/a.onnx")
    assert result.exit_code == 0
    assert "wrote weights/a.onnx and a.json" in result.stdout
    assert "network A, 2,929 parameters, 2 steps" in result.stdout
    assert float(result.stdout.split("ONNX Runtime: ")[1].split()[0]) <= 1e-4
    assert sorted(p.name for p in Path("weights").iterdir()) == ["a.json", "a.onnx"]
    assert run("export", "runs/tiny").exit_code == 0
    assert Path("runs/tiny/tiny.onnx").read_bytes() == Path("weights/a.onnx").read_bytes()


def test_several_networks_one_grown_from_the_other(run):
    Path("wide.toml").write_text('recipe = "tiny.toml"\narchitecture = "B"\nteacher = "tiny"\n')
    result = run("train", "tiny.toml", "wide.toml", "--backgrounds", "none", *CPU)
    assert result.exit_code == 0
    assert [line.split()[0] for line in result.stdout.splitlines() if "is complete" in line] == [
        "runs/tiny",
        "runs/wide",
    ]
    assert report("runs/wide")["config"]["teacher"] == "tiny"


def test_options_of_train(run):
    first = ("train", "tiny.toml", "--backgrounds", "none", *CPU)
    assert run(*first, "--runs", "here", "--seed", 5, "--steps", 1).exit_code == 0
    assert {k: report("here/tiny")["config"][k] for k in ("seed", "steps")} == {"seed": 5, "steps": 1}
    result = run(*first, "--runs", "here", "--seed", 6, "--steps", 1)
    assert result.exit_code == 2
    assert "other settings (seed)" in result.stderr
    assert run(*first, "--runs", "here", "--seed", 6, "--steps", 1, "--fresh").exit_code == 0
    assert report("here/tiny")["config"]["seed"] == 6
    assert run(*first, "--runs", "here", "--overfit", 2).exit_code == 0
    assert report("here/tiny-overfit")["config"]["pool"]["count"] == 2


def test_photographs_that_are_not_there(run):
    result = run("train", "tiny.toml", *CPU)
    assert result.exit_code == 2
    assert "'photographs'" in result.stderr
    assert "--backgrounds DIR, or --backgrounds none" in result.stderr
    assert result.stderr.count("\n") == 1
    assert not Path("runs/tiny").exists()


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["train", "none.toml"], 2, "no such file"),
        (["train", "tiny.toml", "--devices", "0", "--accelerator", "cpu"], 2, "--devices"),
        (["train", "tiny.toml", "--devices", "many"], 2, "--devices"),
        (["train", "tiny.toml", "--accelerator", "steam"], 2, "--accelerator"),
        (["train", "tiny.toml", "--steps", "0"], 2, "--steps"),
        (["export", "nowhere"], 1, "not the folder of a run"),
        (["export", "nowhere", "-o", "a.pb"], 2, "must end in .onnx"),
    ],
)
def test_wrong_use(run, arguments, code, message):
    result = run(*arguments)
    assert result.exit_code == code
    assert message in result.stderr


@pytest.mark.parametrize("verb", ["train", "export"])
def test_without_torch(tmp_path, verb):
    """One line that says what to install; help works all the same."""
    code = "import sys; sys.modules['torch'] = None; from rcdn.cli import main; main()"
    (tmp_path / "c.toml").write_text("")
    command = [sys.executable, "-c", code, verb]
    done = subprocess.run([*command, "c.toml"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr == "error: training: torch not installed; run: pip install 'rcdn[train]'\n"
    assert subprocess.run([*command, "--help"], capture_output=True).returncode == 0
