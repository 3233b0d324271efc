"""Pictures that belong together by the time stamps in their names."""

from __future__ import annotations

from datetime import datetime, timedelta

import numpy as np
import pytest

from rcdn.batch.moments import moments_note, moments_of
from rcdn.batch.pairs import pair_names, pairing_hint
from rcdn.batch.time_stamps import by_time
from rcdn.calibration.board_paths import times_of

START = 1_700_000_000.123456
LOST = ({7, 40}, {20, 51}, {3, 30})
"""the frames that each of three cameras lacks"""
DAY = datetime(2023, 11, 5, 10, 59, 50)


def taken(form, step=0.1, jitter=5e-4, lost=LOST, frames=60):
    """By camera the frame of each picture, and its name: `form` of the time in s, which jitters."""
    rng, frame, names = np.random.default_rng(5), [], []
    for c, without in enumerate(lost):
        frame.append([k for k in range(frames) if k not in without])
        names.append([f"cam{c}/{form(k * step + rng.uniform(-jitter, jitter), k)}.png" for k in frame[-1]])
    return frame, names


def day(pattern):
    return lambda t, k: (DAY + timedelta(seconds=t)).strftime(pattern)


FORMS = {
    "ns": lambda t, k: f"{round((START + t) * 1e9)}",
    "µs": lambda t, k: f"left_{round((START + t) * 1e6)}",
    "ms": lambda t, k: f"{round((START + t) * 1e3)}_exp500",
    "seconds": lambda t, k: f"frame{k:05d}_{START + t:.6f}",
    "seconds and nanoseconds": lambda t, k: f"{int(START + t)}_{round((START + t) % 1 * 1e9):09d}",
    "calendar": day("IMG_%Y%m%d_%H%M%S%f"),
    "calendar with dashes": day("%Y-%m-%dT%H-%M-%S.%f"),
    "since the start, and a number": lambda t, k: f"cam_{k:05d}_{170_000_000 + round(t * 1e6)}",
}


@pytest.mark.parametrize("form", FORMS)
def test_stamps_that_differ_by_little_tell_the_moments(form):
    frames, names = taken(FORMS[form])
    keys, way = moments_of(names)
    assert way.startswith("time, at most ")
    key_of = {k: key for frame, each in zip(frames, keys, strict=True) for k, key in zip(frame, each, strict=True)}
    assert keys == [[key_of[k] for k in frame] for frame in frames]
    assert len(set(key_of.values())) == 60
    time = times_of(key_of.values())
    assert np.diff([time[key_of[k]] for k in range(60)]) == pytest.approx(1, abs=0.05)


def test_the_largest_difference_is_told():
    form = FORMS["ns"]
    one = [f"a/{form(t, 0)}.png" for t in (0, 0.1, 0.2, 0.3)]
    two = [f"b/{form(t, 0)}.png" for t in (0, 0.1002, 0.2999)]
    keys, way = moments_of([one, two])
    assert way == "time, at most 200 µs apart"
    assert moments_note(keys, way) == (
        "note: pictures belong together by time, at most 200 µs apart: 3 moments of several cameras, "
        "1 of one camera only"
    )
    found = pair_names(one, two)
    assert found.pairs == [(0, 0), (1, 1), (3, 2)]
    assert pairing_hint(one, two, found).startswith("paired by time, at most 200 µs apart, 3 pairs: ")
    counted = [[f"{n}_{20_000_000 + 1000 * k + 20 * n * (k == 2)}" for k in range(5)] for n in range(2)]
    assert moments_of(counted)[1] == "time, at most 2 % of the time between pictures apart"


def test_calendar_stamps_in_whole_seconds():
    times = [0, 6, 12, 18, 25, 31, 37]  # over a full hour
    one = [day("IMG_%Y%m%d_%H%M%S")(t, 0) for t in times]
    two = [day("PXL_%Y%m%d_%H%M%S")(t + (k % 3 == 0), 0) for k, t in enumerate(times)]
    assert pair_names(one, two[1:]).pairs == [(k, k - 1) for k in range(1, 7)]
    assert pair_names(one, two).way == "time, at most 1 s apart"


def test_equal_stamps_are_left_to_names_and_numbers():
    _, names = taken(FORMS["ns"], jitter=0)
    assert moments_of(names)[1] == "name"
    assert pair_names(*names[:2]).way == "name"
    assert moments_of(taken(lambda t, k: f"{k}_{round(1e9 * (1 + t))}", jitter=0)[1])[1] == "name"


def test_stamps_in_between_tell_nothing():
    """Cameras that run on their own, half a frame apart, and counts of pictures."""
    step = 10**8
    one, two = ([f"{17 * 10**17 + k * step + late}" for k in range(30)] for late in (0, step // 2))
    assert by_time([one, two]) is None
    rng = np.random.default_rng(0)
    free = [[f"{17 * 10**17 + int(t)}" for t in np.sort(rng.uniform(0, 30 * step, 30))] for _ in range(2)]
    assert by_time(free) is None
    assert by_time([[f"{k:08d}" for k in range(0, 300, 10)], [f"{k:08d}" for k in range(1, 301, 10)]]) is None
    assert by_time([["20231105_0001", "20231105_0002"], ["20231105_0003", "20231105_0004"]]) is None
    twins = [[f"{17 * 10**17 + k * step + late}" for k in range(30)] for late in (0, 9, step // 2, step // 2 + 9)]
    assert by_time(twins[:2]) is not None
    assert by_time(twins) is None  # nothing connects the two pairs
    assert by_time([["1700000000000"], ["1700000000001"]]) is None


def test_cameras_with_times_of_their_own():
    form = FORMS["ns"]
    one = [form(t, 0) for t in (*range(20), *range(100, 105))]
    two = [form(t + 0.001, 0) for t in (*range(50, 70), *range(100, 105))]
    assert pair_names(one, two).pairs == [(k, k) for k in range(20, 25)]


def own_clocks(form, step=0.1, late=(0.0, 0.3009), frames=20):
    """Names of cameras that took the same frames, each stamped by a clock of its own that is `late` by some s."""
    return [[f"cam{c}/{form(k * step + by, k)}.png" for k in range(frames)] for c, by in enumerate(late)]


@pytest.mark.parametrize(
    ("form", "way"),
    [
        (lambda t, k: f"{round((START + t) * 1e9)}_{k:04d}", "number"),
        (lambda t, k: f"{k:06d}_{50_000_000 + round(t * 1e6)}", "order"),
        (lambda t, k: f"{round((START + t) * 1e9)}", "order"),
    ],
)
def test_clocks_that_are_whole_frames_apart_pair_nothing(form, way):
    names = own_clocks(form)
    found = pair_names(*names)
    assert (found.pairs, found.way) == ([(k, k) for k in range(20)], way)
    keys, rule = moments_of(names)
    assert (keys[0], rule) == (keys[1], way)
    keys, rule = moments_of(own_clocks(form, late=(0.0, 0.0002, 0.3009)))
    assert (keys[0], keys[1], rule) == (keys[2], keys[2], way)


def test_clocks_of_cameras_that_take_a_picture_every_few_seconds():
    """Names of equal seconds, one picture apart, are as little evidence."""
    names = own_clocks(day("IMG_%Y%m%d_%H%M%S"), step=5, late=(0, 6))
    assert pair_names(*names).way == moments_of(names)[1] == "order"
    names = own_clocks(day("IMG_%Y%m%d_%H%M%S"), step=5, late=(0, 1))
    assert pair_names(*names).way == moments_of(names)[1] == "time, at most 1 s apart"


def test_numbers_that_agree_come_before_stamps():
    """Of a rig whose trigger counts, some frames were lost; a clock is three frames late."""
    form = FORMS["ns"]
    one, two = (
        [f"{form(0.1 * (k + late), k)}_{k:04d}" for k in range(20) if k not in lost]
        for late, lost in ((0, {4, 9}), (3.009, {12}))
    )
    found = pair_names(one, two)
    assert found.way == "number"
    assert [(one[a][-4:], two[b][-4:]) for a, b in found.pairs] == [
        (f"{k:04d}", f"{k:04d}") for k in range(20) if k not in {4, 9, 12}
    ]
    assert moments_of([one, two])[1] == "number"


def test_stamps_add_to_the_names_that_are_equal():
    one = [day("%Y%m%d_%H%M%S")(t, 0) for t in range(0, 60, 6)]
    two = [day("%Y%m%d_%H%M%S")(t + (t == 18), 0) for t in range(0, 60, 6)]
    assert pair_names(one, two).pairs == [(k, k) for k in range(10)]
    keys, way = moments_of([one, two])
    assert (keys[0], way) == (keys[1], "time, at most 1 s apart")


def test_equal_stamps_stay_together_and_the_nearest_do():
    stamp = day("%Y%m%d_%H%M%S")
    one = [stamp(t, 0) for t in (0, 10, 20, 30, 40, 51)]
    two = [stamp(t, 0) for t in (0, 10, 19, 20, 30, 40, 50)]
    timed = by_time([one, two])
    shared = [(a, timed.keys[1].index(key)) for a, key in enumerate(timed.keys[0]) if key in timed.keys[1]]
    assert shared == [(0, 0), (1, 1), (2, 3), (3, 4), (4, 5), (5, 6)]
    assert pair_names(one, two).pairs == shared
    assert by_time([one[:-1], two]) is None  # all are equal
    form = FORMS["ns"]
    two = [form(t, 0) for t in (0.0001, 0.0999, 0.1998, 0.20001, 0.3, 0.4)]
    assert pair_names([form(k / 10, 0) for k in range(5)], two).pairs == [(0, 0), (1, 1), (2, 3), (3, 4), (4, 5)]
