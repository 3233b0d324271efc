"""Numbers of docs/calibration.md and docs/rigs.md are those of the files in benchmarks/results, digit for digit."""

import pytest
from tests.doc_blocks import ROOT
from tests.test_numbers import cells, rows, states

CALIBRATION, RIGS = (ROOT / "docs/calibration.md").read_text(), (ROOT / "docs/rigs.md").read_text()
SELECTED = {
    "bimalka-webcam": "bimalka",
    "udacity-lane": "udacity-lane",
    "udacity-wide-gopro": "udacity-wide",
    "rochade-gopro-a": "gopro",
    "boof-fisheye-theta": "theta",
    "rig-caliscope, cam_0": "cam_0",
    "rig-caliscope, cam_2": "cam_2",
    "rig-caliscope, cam_3": "cam_3",
}
SOLVERS = {"rcdn": "rcdn", "rcdn, brown": "rcdn, brown", "OpenCV": "opencv"}
RIG_SETS = {
    "boof-trinocular": "trinocular",
    "opencv-left-right": "opencv",
    "sourishg-stereo1": "stereo1",
    "rig-caliscope, four videos": "caliscope",
}
RIG_ROWS = {row["rig"]: row["rig"].split(",")[0] for row in rows("rigs")}
RIG_ROWS["16 around a room, 512 moments"] = "the same"
PEOPLE = ("guided", "random", "coverage", "expert")
FIGURES = ("step_permille", "span_permille", "step_scatter", "span_scatter", "rays_px", "board_px")


@pytest.mark.parametrize("title", SELECTED)
def test_selected_pictures(title):
    row = next(r for r in rows("selected") if r["set"] == SELECTED[title])
    _, count, *ratios = cells(CALIBRATION.replace("\n  | ", "\n| "), title)
    assert int(count) == row["pictures"]
    for many, cell in zip((8, 10, 12), ratios, strict=True):
        random, even = cell.split(", ")
        assert states(random, row[f"of_random_{many}"])
        assert states(even, row[f"of_even_{many}"])


def test_every_row_of_selected_pictures_is_on_the_page():
    assert {r["set"] for r in rows("selected")} == set(SELECTED.values())


@pytest.mark.parametrize("row", rows("guided"), ids=lambda r: f"{r['lens']}, {r['boards']}")
def test_guided_people(row):
    _, *counts, after, stated = cells(CALIBRATION.replace("\n  | ", "\n| "), f"{row['lens']}, {row['boards']}")
    for target, cell in zip((0.1, 0.3), counts, strict=True):
        for person, text in zip(PEOPLE, cell.split(", "), strict=True):
            needed = row[f"{person}_to_{target}"]
            assert text == "–" if needed == float("inf") else states(text, needed)
    for person, text in zip(PEOPLE, after.split(", "), strict=True):
        off = row[f"{person}_at_10"]
        assert text == "–" if off == float("inf") else states(text, off)
    assert states(stated, row["stated_by_true"])


@pytest.mark.parametrize("title", RIG_SETS)
def test_rigs_on_photographs(title):
    of_set = {r["solver"]: r for r in rows("real-rigs") if r["set"] == RIG_SETS[title]}
    lines = [line for line in RIGS.splitlines() if line.startswith(f"| {title} |")]
    assert len(lines) >= 2
    for line in lines:
        _, _, solver, cameras, moments, *figures, _ = (c.strip().replace("*", "") for c in line.split("|"))
        row = of_set[SOLVERS[solver]]
        assert (int(cameras), int(moments)) == (row["cameras"], row["moments"])
        for name, text in zip(FIGURES, figures, strict=True):
            assert states(text, row[name])
    if len(lines) == 2:  # `auto` chose OpenCV's lens model
        assert of_set["rcdn"]["step_permille"] == of_set["rcdn, brown"]["step_permille"]


@pytest.mark.parametrize("row", [*rows("rigs"), *rows("rigs-large")], ids=lambda r: f"{r['rig']}, {r['moments']}")
def test_simulated_rigs(row):
    size = f"| {row['cameras']} | {row['moments']} |"
    [found] = [line for line in RIGS.splitlines() if size in line and line.startswith(f"| {RIG_ROWS[row['rig']]}")]
    *_, connected, one, three, seconds, memory = (cell.strip() for cell in found.strip(" |").split("|"))
    assert connected == f"{row['connected']} of {row['rigs']}"
    for text, key in ((one, "within_1"), (three, "within_3"), (seconds, "cpu_s"), (memory, "memory_MB")):
        assert states(text, row[key])


@pytest.mark.parametrize("row", rows("trust"), ids=lambda r: f"{r['model']}, {r['boards']}")
def test_simulated_deviations(row):
    line = f"| `{row['model']}` | {row['boards']} | "
    [found] = [text for text in CALIBRATION.splitlines() if text.startswith(line)]
    *told, by_noise = found.removeprefix(line).strip(" |").split(" | ")
    for cell, key in zip(told, ("within", "within2", "spread"), strict=True):
        assert states(cell, row[key])
    for cell, px in zip(by_noise.split(" / "), ("0.1", "0.3", "1"), strict=True):
        assert states(cell, row[f"within at {px} px"])


DETECTORS = ("auto", "opencv", "opencv-sb", "boofcv-size")
COMMON = [r for r in rows("calibration") if r["on"] == "common" and r["fit"] and r["detector"] in DETECTORS]


@pytest.mark.parametrize("row", COMMON, ids=lambda r: f"{r['set']}, {r['detector']}")
def test_calibrations_from_the_corners_of_several_detectors(row):
    page = (ROOT / "docs/calibration-results.md").read_text("utf-8")
    name = "geometric mean" if row["set"] == "ALL" else row["set"]
    told = cells(page, name)[-4:][DETECTORS.index(row["detector"])]
    for cell, key in zip(told.split(" / "), ("fit", "pose", "folds"), strict=True):
        assert cell == f"{row[key]:.4f}"


def test_where_our_corners_give_the_lowest_error():
    page = " ".join((ROOT / "docs/calibration-results.md").read_text("utf-8").split())
    sets = {row["set"] for row in COMMON} - {"ALL"}
    lowest = dict.fromkeys(("fit", "pose", "folds"), 0)
    for name in sets:
        own = {row["detector"]: row for row in COMMON if row["set"] == name}
        for key in lowest:
            lowest[key] += min(own, key=lambda d: own[d][key]) == "auto"
    counts = (f"the lowest `{key}` in {count}" for key, count in lowest.items())
    assert f"{', '.join(counts)} of {len(sets)} cameras" in page
