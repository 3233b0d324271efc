"""Every fuzz target for a few inputs with fixed seeds, former failures again, and the campaign itself."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from tests.fuzz import campaign
from tests.fuzz.engine import chosen_at_random
from tests.fuzz.guard import Guard, strict
from tests.fuzz.replay import smallest
from tests.fuzz.source import Source
from tests.fuzz.target import BrokenPromise, Target, must
from tests.fuzz.targets import TARGETS
from tests.fuzz.worker import Job

ROOT = Path(__file__).parents[2]
CORPUS = Path(__file__).parent / "corpus"
OTHERS = [name for name in TARGETS if name != "kernels"]
"""targets that run in this process; kernels are recorded while they are bound"""


@pytest.mark.parametrize("name", OTHERS)
def test_a_few_inputs(name):
    target = TARGETS[name]
    with strict() as printed:
        guard = Guard(target, printed)
        failures = {f for n in range(target.tries) if (f := guard.run(chosen_at_random(1, name, n)))}
    assert not failures


@pytest.mark.parametrize("path", sorted(CORPUS.glob("*/*")), ids=lambda p: f"{p.parent.name}/{p.name}")
def test_former_failures(path):
    """Files that once crashed, hung, or broke a contract, by target."""
    target = TARGETS[path.parent.name.replace("-", " ")]
    with strict() as printed:
        again = Target(target.name, lambda source: path.read_bytes(), target.check)
        assert Guard(again, printed).run(b"") is None


def test_a_campaign_over_the_kernels(tmp_path):
    out = tmp_path / "record.json"
    words = [
        "--targets",
        "kernels",
        "--inputs",
        "300",
        "--seconds",
        "120",
        "--workers",
        "1",
        "--out",
        str(out),
        "--keep",
        str(tmp_path),
    ]
    done = subprocess.run([sys.executable, "-m", "tests.fuzz", *words], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    whole, row = json.loads(out.read_text())["rows"]
    assert row["target"] == "kernels"
    assert row["inputs"] == whole["inputs"] == 300
    assert row["crashes"] == row["hangs"] == row["failures"] == 0
    assert row["peak_mb"] > 50


# ---- the campaign notices


def check_of(name):
    """What a target of that name does with its input, a number."""

    def check(number):
        if number % 5 == 4:
            {
                "raise": lambda: 1 / 0,
                "warn": lambda: __import__("warnings").warn("odd", stacklevel=1),
                "print": lambda: print("odd", flush=True),
                "promise": lambda: must(False, "no good"),
                "lines": _two_lines,
                "fine": lambda: None,
            }[name]()

    return check


def _two_lines():
    from rcdn.errors import RcdnError

    raise RcdnError("one\ntwo")


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("raise", "ZeroDivisionError at"), ("warn", "UserWarning at"), ("print", "printed at odd"),
        ("promise", "BrokenPromise at no good"), ("lines", "message of several lines at"), ("fine", None),
    ],
)  # fmt: skip
def test_a_broken_contract_is_told(name, kind):
    with strict() as printed:
        guard = Guard(Target(name, Source.byte, check_of(name)), printed)
        for value in range(10):
            guard.run(bytes([value]))
    assert guard.tally.inputs == 10
    assert [n for key, n in guard.tally.failures.items() if key.startswith(kind or "")] == ([2] if kind else [])


def test_a_failure_becomes_small():
    def check(values):
        must(not (values[0] > 3 and values[5] == 7), "small")

    target = Target("small", lambda source: [source.byte() for _ in range(40)], check)
    found = smallest(target, bytes([9] * 5 + [7] + [1] * 34))
    with pytest.raises(BrokenPromise):
        check(target.make(Source(found)))
    assert found == bytes([9, 0, 0, 0, 0, 7])


JOB = Job("detections", "random", 1, 0, 3, 60.0, "")


@pytest.mark.parametrize(
    ("code", "what"), [("import os; os.abort()", "crash (exit -6)"), ("import time; time.sleep(60)", "hang")]
)
def test_deaths_and_hangs_are_survived(monkeypatch, code, what):
    """A worker that dies or stands still at each input; inputs go on after it."""
    monkeypatch.setattr(campaign, "WORKER", ["-c", BROKEN.replace("CODE", code)])
    monkeypatch.setattr(campaign, "HANG", 0.3)
    outcome = campaign.run_job(replace(JOB))
    assert outcome.inputs == 3
    assert (outcome.crashes, outcome.hangs) == ((0, 3) if what == "hang" else (3, 0))
    assert all(key.startswith(what) for key in outcome.failures)
    assert {sample["data"] for sample in outcome.samples.values()} == {"010203"}


BROKEN = """
import faulthandler, json, sys
from pathlib import Path
from tests.fuzz.pulse import Pulse
job = json.loads(sys.argv[1])
faulthandler.enable((Path(job["folder"]) / "death").open("w"))
Pulse(Path(job["folder"]) / "pulse").beat(job["first"], bytes([1, 2, 3]))
CODE
"""


def test_choices_are_the_same_for_the_same_seed():
    assert chosen_at_random(3, "vnl", 5) == chosen_at_random(3, "vnl", 5) != chosen_at_random(4, "vnl", 5)
    assert Source(b"").real() == 0.0
    assert Source(b"\x05").below(3) == 2
