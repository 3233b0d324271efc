"""docs/paper-results.md and its pictures are what the files of benchmarks/results give,
and these were measured with the weights that ship."""

import importlib.util
import json
import re
import sys

import pytest
from tests.doc_blocks import ROOT
from tests.test_numbers import cells, rows, states

from rcdn_lab.paper import pixel_claims, refinement_claims, table4_published, table_claims, table_text
from rcdn_lab.paper.networks import NETWORKS
from rcdn_lab.table_weights import load_network

PAGE, RESULTS = (ROOT / "docs/paper-results.md").read_text(), (ROOT / "docs/results.md").read_text()
RECOVERY = (ROOT / "docs/recovery.md").read_text()
FIGURES = {"fig4": pixel_claims, "fig5": pixel_claims, "fig6": refinement_claims}
DETAILS = re.compile(r"<details>.*?</details>", re.S)


def record(name):
    return json.loads((ROOT / f"benchmarks/results/{name}.json").read_text())


def f1(row):
    return 2 * row["precision"] * row["recall"] / (row["precision"] + row["recall"])


def figure(table, row, on):
    """The row of a network on a set."""
    return next(r for r in rows(table) if (r["row"], r["set"]) == (row, on))


@pytest.mark.parametrize("name", ["table2", "table3"])
def test_tables_of_networks(name):
    found = record(name)
    section = table_text.markdown(name, found["rows"], found["provenance"], found["settings"], f"rcdn evaluate {name}")
    assert section.strip() in PAGE


def test_networks_from_two_seeds():
    found = record("seeds")
    section = table_text.markdown("seeds", found["rows"], found["provenance"], found["settings"], "rcdn evaluate seeds")
    assert section.strip() in PAGE


@pytest.mark.parametrize("name", FIGURES)
def test_figures(name):
    found = record(name)
    assert FIGURES[name].markdown(found["rows"]).strip() in PAGE
    assert f"`rcdn evaluate {name}` at commit {found['provenance']['commit']}, {found['provenance']['date']}" in PAGE


def test_table_of_cameras():
    found = record("table4")
    assert table4_published.markdown(found["rows"], table4_published.claims(found["rows"])).strip() in PAGE
    assert f"`rcdn evaluate table4` at commit {found['provenance']['commit']}, {found['provenance']['date']}" in PAGE


def test_what_people_see_first_has_no_long_table():
    """Of the tables that aren't folded none has more than 16 lines."""
    shown = DETAILS.sub("", PAGE)
    assert PAGE.count("<details>") == PAGE.count("</details>") >= 6
    assert max(len(block.splitlines()) for block in re.findall(r"(?:^\|.*\n)+", shown, re.M)) <= 18


@pytest.mark.parametrize("name", ["table2", "table3", "table4", "curves"])
def test_pictures_are_drawn_from_the_files(name, monkeypatch):
    folder = ROOT / "docs/images"
    monkeypatch.syspath_prepend(str(folder))
    spec = importlib.util.spec_from_file_location("draw_paper", folder / "draw_paper.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    sys.modules.pop("draw", None)
    assert module.PICTURES[f"{name}.svg"]() == (folder / "paper" / f"{name}.svg").read_text()
    assert f"(images/paper/{name}.svg)" in PAGE


@pytest.mark.parametrize("text", [PAGE, RESULTS], ids=["paper-results", "results"])
def test_what_is_said_of_f(text):
    for words, on in (
        ("GoPro photographs", "gopro"),
        ("uEye ones", "ueye"),
        ("rendered ones like Mesa's", "mesa-like"),
    ):
        stated = re.search(rf"(\S+) / (\S+) on (?:\d+ )?{words}", text)
        row = figure("table3", "F", on)
        assert states(stated[1], row["precision"]), on
        assert states(stated[2], row["recall"]), on
    mine, other = ({r["set"]: r for r in rows("table3") if r["row"] == row} for row in ("F", "MATE"))
    assert "F1 no lower than MATE's on all five sets" in text
    assert all(f1(mine[s]) > f1(other[s]) - 1e-5 for s in mine)


def test_what_is_said_of_f_beside_its_peers():
    mine, mate, chess = ({r["set"]: r for r in rows("table3") if r["row"] == row} for row in ("F", "MATE", "ChESS"))
    assert "above ChESS' on all; its precision is above MATE's on two." in PAGE
    assert all(f1(mine[s]) > f1(chess[s]) for s in mine)
    assert sum(mine[s]["precision"] > mate[s]["precision"] for s in mine) == 2


def test_what_is_said_of_seeds():
    claims = table_claims.claims_of_seeds(rows("seeds"))
    signs = [sign for claim in claims for sign in claim.signs.values()]
    said = re.search(r"Of (\d+) comparisons (\w+) are significant at 95 %", PAGE)
    assert int(said[1]) == len(signs)
    assert said[2] == {4: "four"}[sum(sign != 0 for sign in signs)]
    assert signs.count(1) == 1  # "F's precision is above MATE's on ueye-like, as the paper says; against it …"
    seen = [row for row in rows("seeds") if row["precision"] is not None]
    assert states(".985", min(row["precision"] for row in seen))
    assert states(".977", min(row["recall"] for row in seen))
    assert "the worst has a precision of .985 and a recall of .977" in PAGE


@pytest.mark.parametrize("text", [PAGE, RESULTS], ids=["paper-results", "results"])
def test_what_is_said_of_cells(text):
    stated = re.search(r"in (\d+) of (\d+) cells\s+of Fig. 4\s+and\s+(\d+) of (\d+) of Fig. 5", text)
    found = []
    for name in ("fig4", "fig5"):
        how = [pixel_claims.standing(cell) for cell in pixel_claims.cells(rows(name))]
        found += [how.count("beats") + how.count("level"), len(how)]
    assert [int(n) for n in stated.groups()] == found


def test_what_is_said_of_cameras():
    table4, four = rows("table4"), rows("calibration_paper")
    mine = [r for r in table4 if (r["detector"], r["on"]) == ("paper", "all")]
    stated = f"finds {sum(r['whole'] for r in mine)} of {sum(r['pictures'] for r in mine)}"
    assert stated in PAGE
    assert stated in RESULTS
    ratios, boof = [], {"cal": 0, "pose": 0}
    for name in {r["set"] for r in mine}:
        for on in ("common", "with paper"):
            here = {r["detector"]: r for r in table4 if (r["set"], r["on"]) == (name, on)}
            if "paper" in here:
                ratios.append(here["paper"]["cal ÷ opencv"])
                boof = {k: n + (here["boofcv-size"][k] < here["paper"][k]) for k, n in boof.items()}
    assert f"(calibration {min(ratios):.2f} to {max(ratios):.3f} of them" in PAGE
    counts = {3: "three", 4: "four"}
    said = f"BoofCV's calibration error is lower on {counts[boof['cal']]}, its pose error on {counts[boof['pose']]}."
    assert said in PAGE
    page = (ROOT / "docs/calibration-results.md").read_text()
    every = [r for r in four if (r["detector"], r["on"], r["set"] != "ALL") == ("paper", "all", True)]
    assert f"finds {sum(r['whole'] for r in every)} of {sum(r['pictures'] for r in every)} boards whole" in page
    for name in {r["set"] for r in every}:
        views, *texts = cells(page[page.index("preset `paper` |") :], name)[1:]
        for detector, text in zip(("auto", "paper"), texts, strict=True):
            row = next(
                r for on in ("common", "with paper") for r in four
                if (r["set"], r["on"], r["detector"]) == (name, on, detector) and _beside_paper(four, name, on)
            )  # fmt: skip
            assert int(views) == row["views"]
            assert all(states(t, row[k]) for t, k in zip(text.split(" / "), ("fit", "folds"), strict=True))


def _beside_paper(four, name, on):
    return any((r["set"], r["on"], r["detector"]) == (name, on, "paper") for r in four)


@pytest.mark.parametrize("kind", ["planar", "tilt 60", "ALL"])
def test_what_is_said_of_recovery(kind):
    title = {"planar": "planar", "tilt 60": "tilt 60°", "ALL": "all 84 boards"}[kind]
    shown = cells(RECOVERY, title)[1:]
    for detector, (whole, recall) in zip(("auto", "paper"), (shown[:2], shown[2:]), strict=True):
        row = next(r for r in rows("recovery") if (r["kind"], r["corners of"]) == (kind, detector))
        assert whole.split(" of ")[0] == f"{row['whole growth']} / {row['whole graph']}"
        assert all(states(t, row[f"recall {k}"]) for t, k in zip(recall.split(" / "), ("growth", "graph"), strict=True))


def shipped(model):
    return load_network(model).facts["sha256"]


@pytest.mark.parametrize("name", ["table2", "table3", "seeds"])
def test_tables_were_measured_with_the_networks_that_ship(name):
    known = record(name)["settings"]["networks"]
    assert {row: facts["sha256"] for row, facts in known.items()} == {
        row: shipped(NETWORKS[row].model) for row in known
    }


@pytest.mark.parametrize("name", FIGURES)
def test_figures_were_measured_with_the_networks_that_ship(name):
    for weights in record(name)["settings"]["weights"].values():
        assert weights["sha256"] == shipped(weights["name"])


@pytest.mark.parametrize("name", ["table4", "recovery", "hard", "sweep_paper", "calibration_paper", "scenes"])
def test_the_preset_was_measured_with_the_network_that_ships(name):
    assert record(name)["settings"]["weights"]["paper"] == shipped("paper")
