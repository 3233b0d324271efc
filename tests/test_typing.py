"""A user's program passes a strict type checker, and a wrong one doesn't: the types reach through the lazy package."""

import os
import subprocess
import sys

import pytest
from tests.doc_blocks import ROOT

WRONG = """import rcdn

name: str = rcdn.calibrate([], spacing=0.025).rms
rcdn.Detector().detect("a.png").nothing
"""


def test_a_strict_checker_accepts_the_example_and_refuses_what_is_wrong(tmp_path):
    pytest.importorskip("mypy")
    (tmp_path / "wrong.py").write_text(WRONG)
    words = ["--strict", "--follow-imports=silent", "--config-file", os.devnull, "--ignore-missing-imports"]
    done = subprocess.run(
        [sys.executable, "-m", "mypy", *words, str(ROOT / "tests/example.py"), "wrong.py"],
        cwd=tmp_path, env=os.environ | {"MYPYPATH": str(ROOT / "src")}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    errors = [line for line in done.stdout.splitlines() if ": error: " in line]
    assert [line.split(": error: ")[0] for line in errors] == ["wrong.py:3", "wrong.py:4"], done.stdout + done.stderr
    assert 'variable has type "str"' in errors[0]
    assert 'no attribute "nothing"' in errors[1]
