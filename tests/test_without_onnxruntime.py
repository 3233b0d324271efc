"""ONNX Runtime is an extra: squares are found without it, and what needs it says so."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from rcdn.io import write_image
from rcdn.synthetic import PRESETS, random_scene, render

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
ABSENT = "import sys; sys.modules['onnxruntime'] = None; sys.path[:0] = {path!r}\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the picture a.png of a board."""
    folder = tmp_path_factory.mktemp("without")
    write_image(folder / "a.png", render(random_scene(np.random.default_rng((1, 1)), PRESETS["ordinary"], (320, 240))))
    return folder


def without(folder, code):
    """What a fresh interpreter that has no ONNX Runtime does with `code`."""
    return subprocess.run(
        [sys.executable, "-c", ABSENT.format(path=[str(ROOT / "src")]) + code],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.mark.parametrize("device", ["cpu", "auto"])
def test_boards_of_squares_need_none(folder, device):
    done = without(folder, f"import rcdn; print(rcdn.Detector(rcdn.DetectorConfig(device={device!r})).boards('a.png'))")
    assert done.stdout.startswith("[<Board "), done.stderr


@pytest.mark.parametrize(
    "config", ["DetectorConfig.paper()", "DetectorConfig(pattern='deltille')", "DetectorConfig(model='rcdn_f')"]
)
def test_other_networks_name_the_extra_before_any_picture(folder, config):
    code = (
        f"import rcdn\ntry:\n    rcdn.Detector(rcdn.{config})\n"
        "except rcdn.RcdnError as error:\n    print(type(error).__name__, error)"
    )
    done = without(folder, code)
    assert done.stdout.startswith("DependencyError the network '")
    assert done.stdout.endswith("ONNX Runtime, which isn't installed; run: pip install 'rcdn[onnx]'\n")


def command(folder, *arguments):
    return without(folder, f"sys.argv = ['rcdn', *{arguments!r}]\nfrom rcdn.__main__ import main\nmain()")


def test_the_command_line_needs_none(folder):
    done = command(folder, "detect", "a.png", "--json", "found.json")
    assert (done.returncode, done.stderr) == (0, "")
    assert '"boards": [{' in (folder / "found.json").read_text()


@pytest.mark.parametrize(
    ("options", "fix"),
    [(["--preset", "paper"], "pip install 'rcdn[onnx]'"), (["--device", "cuda"], "pip install onnxruntime-gpu")],
)
def test_the_command_line_says_it_in_one_line(folder, options, fix):
    done = command(folder, "detect", "a.png", *options)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert done.stderr.startswith("error: ")
    assert fix in done.stderr


def test_the_extra_is_where_it_is_needed():
    extras = PROJECT["optional-dependencies"]
    with_it = {name for name, wanted in extras.items() if any(w.startswith("onnxruntime") for w in wanted)}
    assert not any(w.startswith("onnxruntime") for w in PROJECT["dependencies"])
    assert with_it >= {"onnx", "train", "test"}


def test_a_board_is_found_without_any_heavy_package(folder):
    """Not even one that is installed is loaded: the first board is there at once."""
    code = (
        "import sys, rcdn; boards = rcdn.Detector().boards(rcdn.read_image('a.png')); "
        "print(len(boards), [m for m in {} if m in sys.modules])"
    )
    heavy = ("scipy", "onnxruntime", "torch", "matplotlib", "onnx")
    done = subprocess.run(
        [sys.executable, "-c", code.format(heavy)], cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT / "src")},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stdout == "1 []\n", done.stderr
