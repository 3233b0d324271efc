"""Ctrl-C at moments that are chosen: each is sent from within what it must not disturb."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="needs the signals of Linux")

BEGIN = """
import os, signal, sys, threading
from rcdn import interrupts
signal.signal(signal.SIGINT, signal.default_int_handler)  # who runs the tests may ignore it
interrupts.install()
def interrupt():
    os.kill(os.getpid(), signal.SIGINT)
def then(function):
    def called(*arguments, **more):
        result = function(*arguments, **more)
        interrupt()
        return result
    return called
"""
RUN = """
sys.argv = ["rcdn", "detect", "in", "-j", "1"]
from rcdn.__main__ import main
main()
"""
WHILE_STANDARD_ERROR_GOES = "os.dup2 = then(os.dup2)" + RUN
WHILE_WORDS_ARE_READ = (
    "from rcdn.terminal import group as _group; _group.Group.make_context = then(_group.Group.make_context)" + RUN
)
TWICE = (
    """
from rcdn.terminal import group as _group
_group.Group.make_context = then(_group.Group.make_context)
_group.print_error = then(_group.print_error)
"""
    + RUN
)


def python(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", BEGIN + code], capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize("code", [WHILE_STANDARD_ERROR_GOES, WHILE_WORDS_ARE_READ, TWICE])
def test_ctrl_c_of_the_command_is_one_line(code):
    done = python(code)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "error: stopped by Ctrl-C\n")


HELD = """
try:
    with interrupts.held():
        with interrupts.held():
            interrupt()
            interrupt()
        print("whole")
    print("after the end of the block")
except KeyboardInterrupt:
    print("stopped")
with interrupts.held():
    print("and only once")
"""


def test_ctrl_c_within_a_block_comes_at_its_end():
    done = python(HELD)
    assert (done.returncode, done.stdout, done.stderr) == (0, "whole\nstopped\nand only once\n", "")


READER = """
import itertools, time
from rcdn.batch.work import in_thread
threading.Thread.start = then(threading.Thread.start)
try:
    for _ in in_thread(itertools.count):
        time.sleep(0.01)
except KeyboardInterrupt:
    print(any(t.name == "rcdn-reader" for t in threading.enumerate()))
"""


def test_a_reader_that_has_just_begun_ends():
    """A thread that is still running at the end of the interpreter aborts it."""
    done = python(READER)
    assert (done.returncode, done.stdout, done.stderr) == (0, "False\n", "")


NOT_BEGUN = """
from rcdn.batch.work import in_thread
def no_room(thread):
    raise RuntimeError("can't start new thread")
threading.Thread.start = no_room
try:
    list(in_thread(lambda: [1]))
except RuntimeError as error:
    print(error)
"""


def test_a_reader_that_cannot_begin_says_why():
    done = python(NOT_BEGUN)
    assert (done.returncode, done.stdout, done.stderr) == (0, "can't start new thread\n", "")


THREADS = """
import time
from concurrent.futures import ThreadPoolExecutor
from rcdn.corners.threads import Threads
ThreadPoolExecutor.submit = then(ThreadPoolExecutor.submit)
done = []
def run(item):
    time.sleep(0.01)
    done.append(item)
try:
    Threads()(run, range(300), 3)
except KeyboardInterrupt:
    before = len(done)
    time.sleep(0.5)
    print(len(done) - before <= 2)
"""


def test_threads_that_have_just_begun_leave_the_rest():
    done = python(THREADS)
    assert (done.returncode, done.stdout, done.stderr) == (0, "True\n", "")


PROCESS = """
from rcdn.batch.processes import no_interrupts
other = threading.Thread(target=threading.Event().wait, daemon=True)
other.start()  # it gets the signals that the first thread blocks
try:
    with no_interrupts():
        interrupt()
        for _ in range(100_000):
            pass
        print("whole")
    signal.pause()
except KeyboardInterrupt:
    print("stopped")
os._exit(0 if sys.stdout.flush() is None else 1)
"""


def test_a_process_that_starts_is_not_disturbed_though_other_threads_run():
    done = python(PROCESS)
    assert (done.returncode, done.stdout, done.stderr) == (0, "whole\nstopped\n", "")
