"""OpenCV's log is silent while pictures are read, and afterwards as the program had it, whatever happens meanwhile."""

import contextlib
import os
import sys

import cv2
import pytest

from rcdn.io import quiet
from rcdn.io.quiet import quiet_opencv

logging = cv2.utils.logging


@pytest.fixture(autouse=True)
def level():
    """The level that the program has set."""
    before = logging.setLogLevel(logging.LOG_LEVEL_ERROR)
    yield logging.LOG_LEVEL_ERROR
    logging.setLogLevel(before)


def test_the_level_is_silent_until_the_last_of_several_leaves(level):
    with contextlib.ExitStack() as first, quiet_opencv():
        first.enter_context(quiet_opencv())
        first.close()
        assert logging.getLogLevel() == logging.LOG_LEVEL_SILENT
    assert logging.getLogLevel() == level


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_process_forked_while_a_picture_is_read_can_read_others_and_has_its_log(level):
    with quiet_opencv(), quiet._lock:  # as another thread might hold it
        child = os.fork()
        if not child:
            free = quiet._lock.acquire(timeout=10)
            os._exit(0 if free and logging.getLogLevel() == level else 1)
    assert os.waitpid(child, 0)[1] == 0


def interrupted_at(count):
    """Whether the module still runs at the `count`-th point where Python looks for an interrupt, at the begin of a
    function and after a call; it is interrupted there."""
    left = count

    def profile(frame, event, argument):
        nonlocal left
        if frame.f_code.co_filename == quiet.__file__ and event in ("call", "c_return"):
            left -= 1
            if left == 0:
                raise KeyboardInterrupt

    sys.setprofile(profile)
    try:
        with quiet_opencv():
            pass
    except KeyboardInterrupt:
        return True
    finally:
        sys.setprofile(None)
    return left <= 0


def test_an_interrupt_at_any_point_leaves_the_level_as_it_was(level):
    count = 1
    while interrupted_at(count):
        assert logging.getLogLevel() == level, count
        assert not quiet._lock.locked(), count
        count += 1
    assert count > 10
