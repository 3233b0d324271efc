"""Calibrations compute on one thread, and leave the libraries' threads as they were."""

from __future__ import annotations

import os

import pytest
import scipy.linalg  # noqa: F401  # its own library is limited, too
from threadpoolctl import threadpool_info, threadpool_limits

from rcdn.calibration import calibrate
from rcdn.calibration import one_thread as module
from rcdn.calibration.one_thread import one_thread
from rcdn.errors import CalibrationError
from rcdn_lab.camera_scenes import CAMERAS, SPACING, random_boards


def threads():
    return {pool["filepath"]: pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


@pytest.fixture
def two():
    """Two threads of each library, as on a machine of two cores."""
    with threadpool_limits(2, user_api="blas"):
        before = threads()
        if set(before.values()) != {2}:
            pytest.skip("these libraries have one thread")
        yield before


class Watched(list):
    """Boards that note how many threads there are when they are looked at."""

    def __iter__(self):
        self.threads = threads()
        return super().__iter__()


def test_a_calibration_has_one_thread(two):
    boards = Watched(random_boards(CAMERAS["pinhole"], seed=1, views=6)[0])
    calibrate(boards, SPACING, model="pinhole")
    assert set(boards.threads.values()) == {1}
    assert threads() == two


def test_errors_leave_the_threads_as_they_were(two):
    with pytest.raises(CalibrationError):
        calibrate([], SPACING)
    assert threads() == two


def test_calls_that_overlap_leave_the_threads_as_they_were(two):
    """Threads end their calls in any order."""
    first, second = one_thread(), one_thread()
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert set(threads().values()) == {1}
    second.__exit__(None, None, None)
    assert threads() == two


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_process_forked_during_a_calibration_has_its_threads_and_can_calibrate(two):
    with one_thread(), module._limit.lock:  # as another thread might hold it
        child = os.fork()
        if not child:
            before = threads()
            free = module._limit.lock.acquire(timeout=10)
            os._exit(0 if free and before == two else 1)
    assert os.waitpid(child, 0)[1] == 0
    assert threads() == two
