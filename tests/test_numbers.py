"""Numbers of README.md and docs/results.md are those of the files in benchmarks/results, digit for digit."""

import json
import re
from math import exp, log

import numpy as np
import pytest
from tests.doc_blocks import ROOT

README, RESULTS = (ROOT / "README.md").read_text(), (ROOT / "docs/results.md").read_text()


def rows(name):
    return json.loads((ROOT / f"benchmarks/results/{name}.json").read_text())["rows"]


def all_of(name):
    """The last row, over all sets, of a file of detections."""
    return next(row for row in rows(name) if row["set"] == "ALL")


def states(text, value):
    """Whether `text` (`.0015`, `62 %`) is `value`, rounded to its digits (by a half either way:
    files are rounded, too)."""
    number = re.search(r"\d*\.?\d+", text)[0]
    unit = 10.0 ** -len(number.partition(".")[2])
    scale = 100 if "%" in text else 1
    return abs(float(number) - scale * value) <= 0.5000001 * unit


def cells(text, first):
    """The cells of the table row that begins with `first`, without bold face."""
    line = next(line for line in text.splitlines() if line.replace("*", "").startswith(f"| {first} |"))
    return [cell.strip().replace("*", "") for cell in line.strip("|").split("|")]


def row_with(text, words):
    return next(line for line in text.splitlines() if line.startswith("|") and words in line)


def test_rounding_is_told_from_another_number():
    assert states(".992", 0.9922)
    assert states("62 %", 0.6204)
    assert not states(".992", 0.9931)
    assert not states("1.06", 1.071)


def test_speed_on_photographs():
    record = json.loads((ROOT / "benchmarks/results/photographs-speed.json").read_text())
    at = {(r["pictures"], r["threads"]): r for r in record["photographs"] if r["detector"] == "opencv-sb"}
    boards, small = at["boards", 1], at["boards, under 0.1 MP", 1]
    claim = re.search(
        r"It takes (\S+) of the processor time .* over (\d+) sets of photographs, one thread; (\S+) under 0.1", README
    )
    assert states(claim[1], boards["rcdn ÷ it"])
    assert int(claim[2]) == boards["sets"]
    assert states(claim[3], small["rcdn ÷ it"])
    lead = re.search(r"takes \*\*(\S+)\*\* of the processor time", (ROOT / "docs/speed.md").read_text())
    features = re.search(r"on one thread (\S+) on photographs", (ROOT / "docs/features.md").read_text())
    assert all(states(found[1], boards["rcdn ÷ it"]) for found in (lead, features))


def test_speed_on_photographs_without_avx512():
    record = json.loads((ROOT / "benchmarks/results/photographs-speed-avx2.json").read_text())
    found = {r["pictures"]: r for r in record["photographs"] if r["detector"] == "opencv-sb"}
    at = {pictures: row["rcdn ÷ it"] for pictures, row in found.items()}
    page = (ROOT / "docs/speed.md").read_text()
    claim = re.search(r"it is \*\*(\S+)\*\*, (\S+) under 0.1 megapixel and (\S+) without a board", page)
    alone = re.search(r"with AVX2 alone it is (\S+), and (\S+) in the worst set, a cube of boards", README)
    assert states(alone[1], at["boards"])
    assert found["boards"]["worst set"] == "babelcalib-ov-cube"
    assert all(
        states(told, found["boards"]["worst"])
        for told in (alone[2], re.search(r"takes (\S+) of SB's time, the worst", page)[1])
    )
    assert states(claim[1], at["boards"])
    assert states(claim[2], at["boards, under 0.1 MP"])
    assert states(claim[3], at["no board"])


def test_photographs():
    total, cube = all_of("photographs"), next(r for r in rows("photographs") if r["set"] == "babelcalib-ov-cube")
    whole, labelled = (int(v) for v in total["whole"].split("/"))
    there = labelled - int(cube["whole"].split("/")[1])  # whose boards aren't seen whole
    alarms, negatives = total["alarms"].split("/")
    assert (total["wrong"], total["mislabelled"], alarms) == (0, 0, "0")
    table = cells(RESULTS, "`auto`")
    assert table[1:5] == [f"{whole} of {there}", "0", "0", f"0 of {negatives}"]
    assert states(table[5], total["recall"])
    assert states(table[6], total["raw recall"])
    assert f"| {whole} whole | no corner, no label |" in row_with(README, f"{there} boards with every corner known")
    assert f"| {negatives} pictures of anything but boards | – | no false board |" in README
    seen = re.search(
        r"\| (\.\d+) of the corners \| no corner, no label \|", row_with(README, "22 pictures of boards with codes")
    )
    assert states(seen[1], cube["recall"])
    assert (cube["wrong"], cube["mislabelled"], cube["whole"]) == (0, 0, "0/22")


def test_photographs_made_worse():
    total = all_of("degraded")
    settings = [row for row in rows("degraded") if row["set"] != "ALL"]
    pictures = settings[0]["whole"].split("/")[1]
    found = total["whole"].replace("/", " of ")
    line = row_with(README, "made worse")
    assert line.startswith(f"| {pictures} of these photographs made worse in {len(settings)} ways")
    assert line.endswith(f"| {found} whole | {total['wrong']} corners, no label |")
    assert total["mislabelled"] == 0
    lines = RESULTS.splitlines()
    head = next(k for k, line in enumerate(lines) if line.startswith("| | blur2 |"))
    names, values = ([c.strip() for c in lines[k].strip("|").split("|")] for k in (head, head + 2))
    whole = {row["set"]: row["whole"].split("/")[0] for row in settings}
    assert dict(zip(names[1:-1], values[1:-1], strict=True)) == whole
    assert values[-1] == found
    assert (
        f"Of all their corners {total['recall']:.4f} are in a board; wrong corners {total['wrong']}, wrong labels 0."
        in RESULTS
    )


LEVELS = [
    ("noise", "0"), ("noise", "10"), ("noise", "20"), ("noise", "40"), ("noise", "60"), ("blur", "3"), ("blur", "6"),
    ("tilt", "60"), ("tilt", "75"), ("barrel", "2.5"), ("cover", "quadrant"),
]  # fmt: skip
DETECTORS = {
    "rcdn": ("sweep", "rcdn"), "OpenCV SB, size given": ("sweep_peers", "opencv-sb"),
    "BoofCV": ("sweep_peers", "boofcv"), "OpenCV classic + cornerSubPix, size given": ("sweep_peers", "opencv"),
    "calib-targets": ("sweep_peers", "calib-targets"),
}  # fmt: skip


@pytest.mark.parametrize("title", DETECTORS)
def test_the_sweep(title):
    name, detector = DETECTORS[title]
    known = {(r["factor"], r["level"]): r for r in rows(name) if r["detector"] == detector}
    for text, level in zip(cells(RESULTS, title)[1:], LEVELS, strict=True):
        row = known[level]
        share = re.search(r"\((\d+) %\)", text)
        assert states(f"{share[1]} %" if share else "100 %", row["success"]), (level, text)
        if text.startswith("–"):
            assert row["success"] == 0
        else:
            assert states(text.split(" ")[0], row["mean px"]), (level, text)


def test_the_sweep_has_no_wrong_corner_and_no_false_board():
    mine = rows("sweep")
    assert f"Over all {len(mine)} levels" in RESULTS
    assert sum(row["wrong"] + row["mislabelled"] + row["false"] for row in mine) == 0


@pytest.mark.parametrize(("title", "model"), [("auto (Q)", "auto"), ("paper (F)", "paper")])
def test_the_hard_set(title, model):
    row = next(row for row in rows("hard") if row["model"] == model)
    names = ("f1", "precision", "recall", "ap", "pixel_error")
    for text, name in zip(cells(RESULTS, title)[1:], names, strict=True):
        assert states(text, row[name]), name


def no_fisheyes(solver):
    """Rows of the sets for which OpenCV's solver states deviations."""
    mine = [row for row in rows("repeatability") if not row["set"].startswith("ALL")]
    kept = {row["set"] for row in mine if row["solver"] == "opencv" and row["difference / stated"] is not None}
    return [row for row in mine if row["set"] in kept and row["solver"] == solver]


@pytest.mark.parametrize(("title", "solver"), [("rcdn", "auto"), ("OpenCV's solver, the same corners", "opencv")])
def test_halves_of_pictures(title, solver):
    mine = no_fisheyes(solver)
    assert f"({len(mine)} public sets that aren't fisheyes, {mine[0]['splits']} splits" in RESULTS
    lines = [line.replace("*", "") for line in RESULTS.splitlines() if line.replace("*", "").startswith(f"| {title} |")]
    _, px, ratio, worst, within = (cell.strip() for cell in lines[-1].strip("|").split("|"))
    ratios = [row["difference / stated"] for row in mine]
    assert states(px, exp(np.mean([log(row["px"]) for row in mine])))
    assert states(ratio, float(np.median(ratios)))
    assert states(worst, max(ratios))
    assert states(within, float(np.mean([row["within 1"] for row in mine])))
    assert f" {ratio} of " in README or f"by {ratio} of those of OpenCV's solver" in README


def test_patterns_that_are_no_boards():
    record = json.loads((ROOT / "benchmarks/results/patterns.json").read_text())
    (total,) = [row for row in record["rows"] if row["pattern"] == "all"]
    page = (ROOT / "docs/results.md").read_text()
    false, alone = re.search(r"A false board is found in (\d+) of (\d+)", page).groups()
    whole, behind = re.search(r"corners is whole in (\d+) of (\d+)", page).groups()
    assert [int(n) for n in (false, alone, whole, behind)] == [
        total[name] for name in ("false board", "alone", "whole", "behind a board")
    ]
    assert int(re.search(r"(\d+) pictures of each of eight", page)[1]) == record["settings"]["count"]
    assert len(record["rows"]) == 9
    assert (total["wrong corners"], total["false beside"]) == (0, 0)
