"""A few faults of each kind, with real processes; campaign.py runs any number of them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import fault_runs
import numpy as np
import pytest
from fault_commands import CALIBRATE, DETECT, TRAINING, fresh, heed_ctrl_c, make_home
from fault_runs import Tally

pytestmark = pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="needs the processes of Linux")


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    heed_ctrl_c()
    return make_home(tmp_path_factory.mktemp("home"))


@pytest.fixture(scope="module")
def known(home):
    """What each command leaves if nobody disturbs it, found at the first need."""
    found = {}

    def of(command):
        if command not in found:
            if command is TRAINING:
                pytest.importorskip("torch", reason="needs rcdn[train]")
            found[command] = fault_runs.reference(command, home)
        return found[command]

    return of


@pytest.mark.parametrize("command", [DETECT, CALIBRATE, TRAINING], ids=lambda c: c.name)
def test_killed_runs_leave_whole_files_and_go_on(home, known, command):
    """One of each signal, then the same command again."""
    reference, tally, rng = known(command), Tally(), np.random.default_rng(1)
    fresh(command, home)
    for kind in (signal.SIGKILL, signal.SIGTERM, signal.SIGINT):
        fault_runs.disturb(command, home, reference, kind, float(rng.uniform(0.4, 0.9) * reference.seconds), tally)
    fault_runs.again(command, home, reference, tally)
    assert tally.clean, tally


def test_a_killed_worker_loses_nothing(home, known):
    tally = Tally()
    fault_runs.kill_a_worker(DETECT, home, known(DETECT), 0.5 * known(DETECT).seconds, tally)
    assert tally.clean, tally


def test_two_runs_on_the_same_outputs(home, known):
    tally = Tally()
    fault_runs.two_at_once(DETECT, home, known(DETECT), tally)
    assert tally.clean, tally


# ---- the first moments, and the last ones

EARLY = """
import sys
from rcdn import interrupts
def install(real=interrupts.install):
    real()
    print(flush=True)
interrupts.install = install
sys.argv = ["rcdn", "detect", "in", "-j", "1"]
from rcdn.__main__ import main
main()
"""


@pytest.mark.parametrize("after", [0.0, 0.01, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3])
def test_ctrl_c_while_modules_are_loaded_is_one_line(home, after):
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", EARLY], cwd=home, text=True, **pipes) as process:
        process.stdout.readline()
        time.sleep(after)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate()
    assert (process.returncode, errors.count("\n")) == (130, 1), errors
    assert errors.startswith("error: stopped by Ctrl-C")


def rcdn(home, *words, **options):
    return subprocess.run([sys.executable, "-m", "rcdn", *words], cwd=home, text=True, **options)


BOARD = ("board", "--size", "9x6", "--spacing", "25mm", "-o", "board.pdf")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_full_standard_output_is_one_line(home, unbuffered):
    environment = os.environ | {"PYTHONUNBUFFERED": unbuffered}
    for words in (BOARD, ("--help",), ("--version",)):
        with open("/dev/full", "w") as full:
            done = rcdn(home, *words, stdout=full, stderr=subprocess.PIPE, env=environment)
        assert (done.returncode, done.stderr) == (
            1,
            "error: standard output: can't be written: No space left on device; write it to another place\n",
        )
    with open("/dev/full", "w") as full:
        assert rcdn(home, *BOARD, stdout=subprocess.DEVNULL, stderr=full, env=environment).returncode == 0


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_reader_that_has_enough_is_no_reason_for_words(home, unbuffered):
    reader, writer = os.pipe()
    os.close(reader)
    environment = os.environ | {"PYTHONUNBUFFERED": unbuffered}
    done = rcdn(home, *BOARD, stdout=writer, stderr=subprocess.PIPE, env=environment)
    os.close(writer)
    assert (done.returncode, done.stderr) == (1, "")
    assert (home / "board.pdf").read_bytes().startswith(b"%PDF")
