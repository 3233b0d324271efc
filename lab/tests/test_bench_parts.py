"""What `rcdn bench` measures besides whole detections – stages, a folder, operations a second – and what it writes.
No real time is tested."""

import json
import sys

import numpy as np
import pytest

from rcdn.config import DetectorConfig
from rcdn.detector import Detector
from rcdn.errors import ConfigError, RcdnError
from rcdn_lab.bench import folder, rate, record, stages
from rcdn_lab.bench import watch as _watch
from rcdn_lab.bench.pictures import rendered
from rcdn_lab.bench.resident import resident
from rcdn_lab.bench.run import SB
from rcdn_lab.plots.bench_plot import draw, draw_folder

SMALL = (200, 160)


# ---- stages


def test_the_stages_and_the_rest_are_the_whole():
    rows = stages.stages_of(rendered("board", (320, 240), (9, 6)), "auto", 1, 60.0)
    parts = {row["stage"]: row["ms"] for row in rows}
    whole = parts.pop("whole")
    assert sum(parts.values()) == pytest.approx(whole, abs=0.05)
    assert {"sieve", "response", "boards", "sharpen, fit", "sharpen, smooth", "rest"} <= set(parts)
    assert all(value >= 0 for value in parts.values())
    assert not any(row["note"] for row in rows)


def test_all_stages_are_found_and_detection_passes_through_each():
    """Beside a board there is clutter, so that no view is passed over; cut by the frame, the board is looked at
    enlarged; large pictures are looked at halved first."""
    picture = np.hstack([rendered(kind, SMALL, (9, 6)) for kind in ("board", "clutter")])
    large = [rendered(kind, (640, 480), (9, 6)) for kind in ("board", "clutter")]
    clock = stages.Clock()
    with stages.watched(clock, [(place, place) for _, place in stages.STAGES]) as absent:
        for preset in ("auto", "paper"):
            for seen in (picture, picture[:, 30:], *large):
                Detector(DetectorConfig.preset(preset, threads=1)).detect(seen)
    assert absent == []
    assert set(clock.calls) == {place for _, place in stages.STAGES}


def test_what_is_no_function_is_not_found():
    """`rcdn.corners.nms` is a module, not the function in it."""
    with stages.watched(stages.Clock(), [("nms", "rcdn.corners:nms")]) as absent:
        assert absent == ["rcdn.corners:nms"]


def test_inner_stages_count_once_and_everything_is_as_it_was():
    clock = stages.Clock()
    before = _Work.outer, _Work.inner
    places = [("outer", f"{__name__}:_Work.outer"), ("inner", f"{__name__}:_Work.inner")]
    gone = [("x", f"{__name__}:_Work.gone"), ("y", "rcdn.no_such_module:f")]
    with stages.watched(clock, places + gone) as absent:
        assert _Work().outer() == 6
    assert absent == [place for _, place in gone]
    assert clock.calls == {"inner": 3, "outer": 1}
    assert (_Work.outer, _Work.inner) == before


class _Work:
    def outer(self):
        return sum(self.inner() for _ in range(3))

    def inner(self):
        return 2


def test_the_time_of_a_stage_is_without_those_inside(monkeypatch):
    ticks = iter([0.0, 1.0, 4.0, 10.0])  # outer starts, inner starts, inner ends, outer ends
    monkeypatch.setattr(stages.time, "process_time", lambda: next(ticks))
    clock = stages.Clock()
    inner = clock.wrapped("inner", lambda: None)
    clock.wrapped("outer", inner)()
    assert clock.seconds == {"inner": 3.0, "outer": 7.0}


# ---- folder


def test_each_picture_of_a_folder_is_noted(tmp_path):
    seen = tmp_path / "seen.csv"
    assert list(_watch.watched(lambda n: iter_of(n), seen)(5)) == [0, 1, 2, 3, 4]
    lines = folder.read_samples(seen)
    assert [line["pictures"] for line in lines] == [1, 2, 3, 4, 5]
    if resident("VmRSS") is not None:
        assert all(0 < line["now MB"] <= line["peak MB"] for line in lines)
    assert folder.folder_row(lines, 1, 5, 10.0)["a second"] == 0.5
    with pytest.raises(RcdnError, match="5 of 6"):
        folder.folder_row(lines, 1, 6, 1.0)


def iter_of(count):
    yield from range(count)


def test_the_steady_rate_leaves_the_start_out():
    lines = [{"seconds": 5 + k / 4, "pictures": k + 1, "now MB": 100.0 + k, "peak MB": 200.0} for k in range(20)]
    row = folder.folder_row(lines, 2, 20, 10.0)
    assert (row["steady a second"], row["a second"], row["peak MB"]) == (4, 2, 200)
    assert (row["MB at 10 %"], row["MB at the end"]) == (102, 119)
    assert (row["ms, first half"], row["ms, second half"]) == (250, 250)


def test_samples_are_thinned_evenly():
    lines = [{"pictures": k} for k in range(1001)]
    few = [line["pictures"] for line in folder.thinned(lines, 11)]
    assert few == list(range(0, 1001, 100))
    assert folder.thinned(lines[:11], 11) == lines[:11]


def test_time_and_memory_along_a_folder_are_drawn():
    figures = pytest.importorskip("matplotlib.figure", reason="plots need matplotlib")
    samples = [{"jobs": j, "seconds": k / j, "pictures": k, "now MB": 100.0 * j} for j in (1, 2) for k in (1, 50, 100)]
    figure = figures.Figure()
    draw_folder(figure, samples)
    time, memory = figure.axes
    assert [line.get_label() for line in time.lines] == ["1 job", "2 jobs"]
    assert time.lines[1].get_ydata().tolist() == [0.5, 25, 50]
    assert memory.lines[1].get_ydata().tolist() == [200, 200, 200]


def test_a_folder_through_rcdn_detect(tmp_path):
    found = folder.watch([sys.executable, "-m", "rcdn_lab.bench.watch"], [1], 2)
    assert [(r["pictures"], r["jobs"]) for r in found["rows"]] == [(2, 1)]
    assert [s["pictures"] for s in found["samples"]] == [1, 2]
    with pytest.raises(RcdnError, match="--folder"):
        folder.watch([sys.executable, "-c", "raise SystemExit('no')"], [1], 1)


def test_a_large_folder_repeats_its_pictures(tmp_path, monkeypatch):
    monkeypatch.setattr(folder, "DISTINCT", 1)
    folder.fill(tmp_path, 3)
    assert len({path.read_bytes() for path in tmp_path.iterdir()}) == 1
    assert len(list(tmp_path.iterdir())) == 3


# ---- operations a second


def test_rates_are_medians_and_the_ratio_is_of_the_same_round():
    """The machine gets slower tenfold in the middle: both do, and the ratio stays."""
    taken = {
        "network": iter([9.0, 2, 2, 20, 20, 2]),
        "small": iter([9.0, 4, 4, 40, 40, 4]),
        "large": iter([9.0, 1, 1, 10, 10, 1]),
    }
    now, log = [0.0], []

    def work(name):
        log.append(name)
        now[0] += next(taken[name])

    todo = {name: (4e9, lambda name=name: work(name)) for name in taken}
    found = {row["task"]: row for row in rate.rates(todo, 5, clock=lambda: now[0])}
    assert [(r["GFLOP/s"], r["at best"], r["of peak"], r["from"], r["to"]) for r in found.values()] == [
        (2, 2, 0.5, 0.5, 0.5), (1, 1, 0.25, 0.25, 0.25), (4, 4, 1, 1, 1),
    ]  # fmt: skip
    assert {(r["GFLOP"], r["rounds"]) for r in found.values()} == {(4, 5)}
    assert found["network"]["ms"] == 2000
    assert all(sorted(log[k : k + 3]) == sorted(taken) for k in range(0, 18, 3))


def test_the_peak_is_a_product_even_if_the_network_is_faster():
    now = [0.0]

    def work(seconds):
        now[0] += seconds

    todo = {"network": (1e9, lambda: work(1)), "product": (1e9, lambda: work(2))}
    assert [row["of peak"] for row in rate.rates(todo, 3, clock=lambda: now[0])] == [2, 1]


def test_operations_are_those_of_the_pixels_and_of_the_products():
    todo = rate.tasks((200, 160), (8,))
    (network, respond), (product, multiply) = todo.values()
    assert network == 2 * 200 * 160 * 34112  # layers of 13-3-3-3-1-1 px with 32 channels
    assert product == 2 * 8**3
    response, ones = respond(), multiply()
    assert response.shape == (160, 200)
    assert response.max() > 0.5
    assert (ones.shape, ones.dtype) == ((8, 8), np.float32)


# ---- what it writes


def sweep_file(path, rows, preset="auto"):
    path.write_text(json.dumps({"settings": {"preset": preset}, "rows": rows}))
    return path


def success(detector, *values):
    return [{"detector": detector, "success": value} for value in values]


def test_quality_is_the_mean_success(tmp_path):
    one = sweep_file(tmp_path / "a.json", success("rcdn", 1, 0) + success("boofcv", 0.25) + success("raw", None))
    two = sweep_file(tmp_path / "b.json", success("rcdn", 0.75), "paper")
    assert record.quality([one, two]) == {"rcdn": 0.5, "boofcv": 0.25, "rcdn-paper": 0.75}
    (tmp_path / "c.json").write_text('{"rows": []}')
    for bad in ("c.json", "nowhere.json"):
        with pytest.raises(ConfigError, match="--sweep"):
            record.quality([tmp_path / bad])


def test_tables_for_the_docs_keep_boards_and_failures_apart():
    base = {"picture": "board", "size": "640x480", "board": "9x6", "threads": 2, "ratio": 1.0, "ms": 123.4}
    rows = [
        base | {"detector": "a"}, base | {"detector": "a", "size": "1x1", "ms": 1.234},
        base | {"detector": "b", "ms": None}, base | {"detector": "a", "board": "7x7", "ms": 12.34, "ratio": None},
    ]  # fmt: skip
    assert record.markdown({"speed": rows}).splitlines() == [
        "| board, 2 threads: ms (ratio) | 640x480 | 1x1 |", "| --- | --- | --- |", "| a | 123 (1.00) | 1.23 (1.00) |",
        "| b | failed |  |", "| a, 7x7 | 12.3 |  |",
    ]  # fmt: skip


def test_the_other_tables_for_the_docs():
    tables = {
        "stages": [{"preset": "auto", "picture": "board", "size": "1x1", "stage": "nms", "ms": 5.0, "share": 0.25}],
        "memory": [{"detector": "a", "size": "1x1", "peak MB": 99.6, "more MB": 9.9, "note": ""},
                   {"detector": "b", "size": "1x1", "peak MB": None, "more MB": None, "note": "needs Linux"}],
        "first": [{"detector": "a", "import ms": 1.5, "make ms": None}],
    }  # fmt: skip
    text = record.markdown(tables)
    lines = [
        "| nms | 5.00 (25 %) |",
        "| a | 100 (10) |",
        "| b | needs Linux |",
        "| detector | import ms | make ms |",
        "| a | 1.5 | - |",
    ]
    assert [line for line in text.splitlines() if line in lines] == lines


def test_a_busy_machine_is_one_with_work_to_do(monkeypatch):
    monkeypatch.setattr(record, "_cores", lambda: 4)
    assert record.busy(2.0)
    assert not record.busy(0.5)
    assert not record.busy(None)


def test_the_plot_shows_who_has_both_time_and_quality():
    figure = pytest.importorskip("matplotlib.figure", reason="plots need matplotlib").Figure()
    base = {"picture": "board", "size": "640x480", "threads": 1}
    rows = [
        base | {"detector": "rcdn", "ratio": 0.5}, base | {"detector": SB, "ratio": 1.0},
        base | {"detector": SB, "ratio": 7.0}, base | {"detector": "failed", "ratio": None},
        base | {"detector": "unknown", "ratio": 3.0}, base | {"detector": "rcdn", "ratio": 9.0, "threads": 2},
        base | {"detector": "rcdn", "ratio": 9.0, "picture": "clutter"},
    ]  # fmt: skip
    samples = [{"jobs": j, "pictures": k, "now MB": 10.0 * j} for j in (1, 2) for k in (1, 2)]
    draw(figure, rows, {"rcdn": 0.9, SB: 0.8, "failed": 0.1}, samples)
    speed, memory = figure.axes
    spots = {line.get_label(): (*line.get_xdata(), *line.get_ydata()) for line in speed.lines}
    assert {name: spots[name] for name in ("rcdn", SB)} == {"rcdn": (0.5, 0.9), SB: (1.0, 0.8)}
    assert len(speed.lines) == 3  # and the line of the yardstick
    assert [line.get_ydata().tolist() for line in memory.lines] == [[10.0, 10.0], [20.0, 20.0]]
