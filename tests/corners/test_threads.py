"""One pool of threads as long as its owner lives."""

import copy
import gc
import os
import pickle
import threading
import time

import numpy as np
import pytest

from rcdn.corners.threads import Threads
from rcdn.detector import Detector


def names(threads, count=3, items=12):
    """The threads that ran something."""
    seen, gate = set(), threading.Barrier(count)

    def run(item):
        if item < count:
            gate.wait(20)  # so that all take part
        seen.add(threading.current_thread())

    threads(run, range(items), count)
    return seen


def test_everything_is_run_once():
    done = []
    for count in (0, 1, 2, 5, 100):
        done.clear()
        Threads()(done.append, range(20), count)
        assert sorted(done) == list(range(20))
    Threads()(done.append, [], 4)


def test_the_caller_takes_part_and_the_others_are_kept():
    threads = Threads()
    first, second = names(threads), names(threads)
    assert len(first) == 3
    assert threading.current_thread() in first
    assert first == second


def test_one_thread_needs_no_pool():
    threads = Threads()
    assert names(threads, count=1) == {threading.current_thread()}
    assert threads._pool is None


def test_no_more_than_asked_for_run_at_once():
    threads, busy, most = Threads(), [], []

    def run(item):
        busy.append(item)
        most.append(len(busy))
        time.sleep(0.001)
        busy.pop()

    names(threads, count=6)
    threads(run, range(50), 2)
    assert max(most) <= 2


@pytest.mark.parametrize("where", [0, 11])
def test_what_is_raised_comes_out_when_all_have_stopped(where):
    threads, running = Threads(), []

    def run(item):
        running.append(item)
        time.sleep(0.002)
        running.remove(item)
        if item == where:
            raise KeyError(item)

    with pytest.raises(KeyError):
        threads(run, range(12), 3)
    assert not running
    assert len(names(threads)) == 3  # it goes on


def test_several_threads_use_it_at_once():
    threads, sums = Threads(), []

    def use():
        mine = []
        threads(mine.append, range(200), 4)
        sums.append(sum(mine))

    users = [threading.Thread(target=use) for _ in range(8)]
    for user in users:
        user.start()
    for user in users:
        user.join()
    assert sums == [sum(range(200))] * 8


def test_its_threads_go_with_it():
    threads = Threads()
    own = names(threads) - {threading.current_thread()}
    del threads
    gc.collect()
    for thread in own:
        thread.join(20)
        assert not thread.is_alive()


def test_copies_have_their_own():
    threads = Threads()
    names(threads)
    for other in (copy.copy(threads), copy.deepcopy(threads), pickle.loads(pickle.dumps(threads))):
        assert other._pool is None
        assert len(names(other)) == 3


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_process_has_its_own():
    threads = Threads()
    names(threads)
    with threads._lock:  # as another thread might hold it
        child = os.fork()
        if not child:
            os._exit(0 if len(names(threads)) == 3 else 1)
    assert os.waitpid(child, 0)[1] == 0


def picture():
    noise = np.random.default_rng(1).normal(0, 20, (400, 400))
    squares = 60 + 120 * ((np.arange(400)[:, None] // 40 + np.arange(400) // 40) % 2)
    return np.clip(squares + noise, 0, 255).astype(np.uint8)


def test_a_detector_has_one_pool(monkeypatch):
    """Of old, one for each picture."""
    import rcdn.corners.threads as module

    made = []
    pool = module.ThreadPoolExecutor
    monkeypatch.setattr(module, "ThreadPoolExecutor", lambda *a, **k: made.append(1) or pool(*a, **k))
    monkeypatch.setattr("os.cpu_count", lambda: 4)
    detector = Detector()
    assert not made
    first = detector.response(picture())
    for _ in range(3):
        np.testing.assert_array_equal(detector.response(picture()), first)
    detector._model.by_onnx_runtime(picture(), tile=128)
    assert len(made) == 1


def test_detectors_are_copied_and_pickled():
    detector = Detector()
    first = detector.detect(picture())
    for other in (copy.copy(detector), copy.deepcopy(detector), pickle.loads(pickle.dumps(detector))):
        found = other.detect(picture())
        assert found.corners.xy.tobytes() == first.corners.xy.tobytes()
        assert [b.xy.tobytes() for b in found.boards] == [b.xy.tobytes() for b in first.boards]


def test_ctrl_c_while_a_thread_begins_leaves_no_thread(monkeypatch):
    """At the end of the program it would be waited for, and nobody would tell it to end."""
    start = threading.Thread.start

    def interrupted(thread):
        start(thread)
        raise KeyboardInterrupt

    before, pool = set(threading.enumerate()), Threads()  # held, as a detector holds it
    with monkeypatch.context() as patched:
        patched.setattr(threading.Thread, "start", interrupted)
        with pytest.raises(KeyboardInterrupt):
            pool(str, range(8), 2)
    for thread in set(threading.enumerate()) - before:
        thread.join(5)
        assert not thread.is_alive()
    pool(str, range(8), 2)  # and another one is made
