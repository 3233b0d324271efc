"""Tables 2 and 3: known answers, both readings, rows that are skipped, claims, the commands."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from rcdn.config import Adaptive, Fixed, MaxFraction, Std
from rcdn.errors import ConfigError
from rcdn_lab.cli.evaluate import tables as verbs
from rcdn_lab.paper import table_claims, table_text, tables
from rcdn_lab.paper.networks import NETWORKS, TWICE, Network
from rcdn_lab.paper.published import COLUMNS, CROSS_ENTROPY, SQUARED, TABLE2, TABLE3
from rcdn_lab.paper.score import Counts, chess_detections, count, detections, rules
from rcdn_lab.paper.sets import SETS, shots
from rcdn_lab.peers.chess import chess_response

APP = typer.Typer(rich_markup_mode=None)
APP.command("table2")(verbs.table2)
APP.command("table3")(verbs.table3)
NONE = np.zeros((0, 2))


def bumps(size, spots, height=1.5):
    """A response map (H, W) with a bump of 5×5 px at each spot."""
    out = np.zeros(size[::-1], np.float32)
    y, x = np.mgrid[: size[1], : size[0]]
    for u, v in np.rint(spots):
        out = np.maximum(out, height * np.exp(-((x - u) ** 2 + (y - v) ** 2) / 2).astype(np.float32))
    return out


def knowing(known, strays=()):
    """What gives networks that answer exactly at the truth of these pictures, and at `strays`."""

    def load(row):
        def respond(image):
            shot = next(s for s in known if np.array_equal(image, s.image()))
            return bumps(shot.size, np.concatenate([shot.xy, np.reshape(strays, (-1, 2))]))

        return respond

    return load


@pytest.fixture
def every_network(monkeypatch):
    """All rows have weights, if not their own."""
    for row, network in NETWORKS.items():
        monkeypatch.setitem(NETWORKS, row, replace(network, model="paper"))


# ---- counts


def test_each_detection_at_a_corner_is_right():
    xy = np.array([(20, 20), (30, 20), (40, 20)])
    assert count(xy, xy, NONE) == Counts(1, 3, 3, 3, 3, 3, 1.0, 1.0)
    found = count(xy[:2] + np.array([3, 0]), xy, NONE)
    assert found.rates == found.strict == (1.0, 2 / 3)


def test_a_second_detection_of_one_corner_is_true_in_the_papers_reading_only():
    xy = np.array([(20.0, 20), (60, 20)])
    found = count(np.array([(20, 20), (23, 20), (60, 22), (90, 20)]), xy, NONE)
    assert (found.found, found.near, found.reached, found.pairs) == (4, 3, 2, 2)
    assert found.rates == (0.75, 1.0)
    assert found.strict == (0.5, 1.0)


def test_four_px_are_too_far():
    assert count(np.array([(24, 20)]), np.array([(20, 20)]), NONE).near == 0
    assert count(np.array([(23.99, 20)]), np.array([(20, 20)]), NONE).near == 1


def test_what_is_ignored_counts_neither_way():
    xy, ignore = np.array([(20, 20)]), np.array([(50, 20), (22, 20)])
    for found in (np.array([(20, 20)]), np.array([(20, 20), (52, 20)]), np.array([(21, 20), (50, 20)])):
        assert count(found, xy, ignore).rates == (1.0, 1.0)
    assert count(np.array([(20, 20), (55, 20)]), xy, ignore).rates == (0.5, 1.0)
    assert count(np.array([(50, 20)]), xy, ignore).rates == (0.0, 0.0)


def test_sums_are_of_all_detections_together_and_means_of_pictures():
    one = count(np.array([(20, 20)]), np.array([(20, 20)]), NONE)
    two = count(np.array([(20, 20), (40, 20), (60, 20)]), np.array([(20, 20), (80, 80)]), NONE)
    both = one + two
    assert both.rates == (2 / 4, 2 / 3)
    assert both.precisions / both.pictures == pytest.approx((1 + 1 / 3) / 2)
    assert Counts().rates == (0.0, 0.0)


# ---- rules


def test_the_rules_are_those_of_table_2():
    assert rules(NETWORKS["A"]) == {
        "0.5": Fixed(0.5), "std": Std(0.8), "max": MaxFraction(0.41), "adaptive": Adaptive()
    }  # fmt: skip
    mate = rules(NETWORKS["MATE"])
    assert (mate["std"], mate["max"]) == (Std(1.7), MaxFraction(0.57))


def test_a_threshold_decides_which_bumps_are_corners():
    spots = np.array([(20, 20), (40, 20), (60, 20)])
    response = np.maximum.reduce([bumps((90, 40), s[None], h) for s, h in zip(spots, (2.0, 1.2, 0.6), strict=True)])
    assert len(detections(response, Fixed(0.5))) == 3
    assert len(detections(response, MaxFraction(0.41))) == 2
    np.testing.assert_array_equal(detections(response, Fixed(1.5)), spots[:1])
    assert len(detections(response * 0.2, Adaptive())) == 0


def test_corners_at_the_border_and_small_clusters_go():
    grid = np.stack(np.meshgrid(np.arange(9), np.arange(6)), axis=-1).reshape(-1, 2) * 12 + 20
    far = np.array([(380, 280)])
    response = bumps((400, 300), np.concatenate([grid, far, [(4, 150)]]))
    np.testing.assert_array_equal(np.unique(detections(response, Adaptive()), axis=0), np.unique(grid, axis=0))


def test_chess_finds_corners_and_drops_those_that_are_alone():
    for shot in shots(SETS["mesa-like"], most=2):
        response = chess_response(shot.image())
        assert count(chess_detections(response, 0.0), shot.xy, NONE).strict[1] > 0.9
    assert len(chess_detections(np.zeros((40, 40), np.float32), 0.0)) == 0
    alone = np.zeros((40, 40), np.float32)
    alone[20, 20] = 1
    assert len(chess_detections(alone, 0.0)) == 0
    two = np.zeros((40, 60), np.float32)
    two[20, 20:22], two[20, 40:42] = (3, 2), (1, 0.5)
    np.testing.assert_array_equal(chess_detections(two, 0.0), [(20, 20), (40, 20)])
    np.testing.assert_array_equal(chess_detections(two, 0.45), [(20, 20)])


# ---- the published figures


def test_mate_is_net_a_with_the_squared_loss():
    assert TABLE3["MATE"] == TABLE2[SQUARED, "adaptive"]
    assert TABLE3["A"] == TABLE2[CROSS_ENTROPY, "adaptive"]


def test_every_line_has_the_papers_figures():
    for lines in tables.LINES.values():
        for line in lines:
            for column in COLUMNS:
                assert all(0 <= v <= 1 for v in line.paper(column))
    assert len(tables.LINES["table2"]) == len(TABLE2) == 8
    assert [line.row for line in tables.LINES["table3"]] == list(TABLE3)
    assert {s.column for s in SETS.values()} == set(COLUMNS)


# ---- the tables


def test_a_network_that_knows_the_truth_is_perfect(every_network):
    what = tables.plan("table2", sets=["mesa-like"], most=2)
    rows = tables.table(what, load=knowing(what.sets["mesa-like"]))
    assert len(rows) == 8
    for row in rows:
        assert (row["precision"], row["recall"], row["strict precision"], row["strict recall"]) == (1, 1, 1, 1)
        assert (row["corners"], row["pictures"]) == (108, "2/206")
    std = next(r for r in rows if (r["network"], r["method"]) == (SQUARED, "std"))
    assert (std["threshold"], std["paper precision"], std["paper recall"]) == ("std 1.7", 0.9992, 0.9960)
    assert std["precision difference"] == pytest.approx(0.0008)


def test_false_alarms_lower_precision_only(every_network):
    what = tables.plan("table3", sets=["mesa-like"], most=1)
    (shot,) = what.sets["mesa-like"]
    spots = np.stack(np.meshgrid([15, 30, 45], [15, 30, 45]), axis=-1).reshape(-1, 2)
    far = spots[np.linalg.norm(spots[:, None] - shot.xy, axis=2).min(axis=1) > 15]
    rows = tables.table(what, load=knowing([shot], far))
    line = next(r for r in rows if r["row"] == "F")
    assert 0 < line["found"] - 54 <= len(far)
    assert line["recall"] == 1
    assert line["precision"] == pytest.approx(54 / line["found"], abs=1e-5)


def test_rows_do_not_depend_on_the_processes(monkeypatch):
    monkeypatch.setitem(tables.LINES, "table3", tuple(n for n in tables.LINES["table3"] if n.row in ("F", "ChESS")))
    what = tables.plan("table3", sets=["mesa-like"], most=2)
    calls = []
    one = tables.table(what, 1, progress=lambda done, total: calls.append((done, total)))
    assert one == tables.table(what, 2)
    assert calls == [(1, 2), (2, 2)]
    assert {r["row"] for r in one} == {"F", "ChESS"}
    assert all(r["recall"] > 0.5 for r in one)


def test_missing_weights_and_photographs_are_rows_that_say_so(monkeypatch, tmp_path):
    monkeypatch.setitem(NETWORKS, "A", Network("A", "tables/absent"))
    monkeypatch.setitem(NETWORKS, "MATE", Network("MATE", "paper"))
    what = tables.plan("table2", tmp_path, sets=["mesa-like", "gopro"], most=1)
    rows = tables.table(what, load=knowing(what.sets["mesa-like"]))
    assert [(r["row"], r["set"]) for r in rows] == [("A", "-"), *[("MATE", "mesa-like")] * 4, ("-", "gopro")]
    assert "tables/absent" in rows[0]["note"]
    assert str(tmp_path) not in rows[0]["note"]
    assert "RCDN_DATA" in rows[-1]["note"]
    assert rows[0]["precision"] is None
    assert tables.settings_of(what)["skipped"].keys() == {"A", "gopro"}
    assert "not checked" in "\n".join(table_text.claim_lines("table2", rows))


def test_default_and_full_counts(tmp_path):
    assert {n: (s.default, s.total) for n, s in SETS.items()} == {
        "mesa-like": (206, 206), "ueye-like": (24, 206), "ueye": (5, 5), "gopro-like": (10, 100), "gopro": (30, 30)
    }  # fmt: skip
    assert len(tables.plan("table2", sets=["gopro-like"]).sets["gopro-like"]) == 10
    assert len(tables.plan("table2", full=True, sets=["gopro-like"], most=12).sets["gopro-like"]) == 12
    with pytest.raises(ConfigError, match="known: mesa-like"):
        tables.plan("table2", sets=["mesa"])
    with pytest.raises(ConfigError, match="--data"):
        tables.plan("table2", tmp_path / "nothing")


# ---- claims


def verdicts(table, figures):
    return {c.text: c.verdict for c in table_claims.claims(table, figures)}


def find(found, *words):
    return next(v for text, v in found.items() if all(w in text for w in words))


def test_what_the_papers_own_tables_say_about_its_claims():
    found = verdicts("table3", table_claims.published("table3"))
    assert find(found, "D-1, D-3") == "holds"
    assert find(found, "A → B") == "holds"
    assert find(found, "E-32 → F") == "holds on 2 of 3"  # on GoPro F loses precision
    assert find(found, "recall than MATE") == "holds"
    assert find(found, "recall than ChESS") == "holds"
    assert find(found, "precision than MATE") == "holds on 2 of 3"
    assert find(found, "grows with depth") == "holds on 2 of 3"  # E-32 is a little worse than D-1
    found = verdicts("table2", table_claims.published("table2"))
    assert find(found, "lower precision than the adaptive") == "holds"
    assert find(found, "Std-threshold is worse than 0.5") == "holds on 2 of 6"
    assert find(found, "on GoPro") == "holds"
    assert find(found, "close to a share") == "holds"
    assert find(found, "nearly all") == "holds (10 of 12)"


def test_a_claim_is_judged_by_the_figures_it_is_given():
    good, bad = {"x": (0.99, 0.99), "y": (1.0, 0.98)}, {"x": (0.99, 0.97), "y": (1.0, 0.98)}

    def verdict(one, two):
        return find(verdicts("table3", {("D-1", "adaptive"): one, ("D-3", "adaptive"): two}), "D-1, D-3")

    assert verdict(good, bad) == "holds"
    assert verdict(bad, good) == "doesn't hold"
    assert verdict(good, good) == "equal"
    assert verdict(good, {"x": (1, 1), "y": (0.5, 0.5)}) == "holds on 1 of 2"
    assert verdict(good, {}) == "not checked"
    (claim,) = (
        c
        for c in table_claims.claims("table3", {("F", "adaptive"): good, ("ChESS", "max"): bad})
        if "recall than ChESS" in c.text
    )
    assert claim.details == "x: F 0.9900, ChESS 0.9700; y: F 0.9800, ChESS 0.9800"


def two_seeds(gap, apart=0.002, rows=TWICE):
    """Rows of networks whose seeds are `apart` in precision and recall; D-1 and H are better by `gap`."""
    out = []
    for row, pair in rows.items():
        for name, side in zip(pair, (-1, 1), strict=True):
            rate = 0.96 + (gap if row in ("D-1", "H") else 0) + side * apart / 2
            out += [
                {"row": name, "method": "adaptive", "set": s, "precision": rate, "recall": rate} for s in ("x", "y")
            ]
    return out


@pytest.mark.parametrize("count", [11, 4])
def test_a_difference_counts_beyond_the_scatter_of_seeds(count):
    """Pairs that all differ by d: σ = d ÷ √2, which is that of the difference of two means of two, too; Student's t has
    one degree of freedom a network."""
    some = dict(list(TWICE.items())[:count] + [(row, TWICE[row]) for row in ("D-1", "D-3")])
    least = 0.002 / 2**0.5 * {11: 2.201, 5: 2.571}[len(some)]
    for gap, sign in ((0.99 * least, 0), (1.01 * least, 1), (-1.01 * least, -1)):
        claims = table_claims.claims_of_seeds(two_seeds(gap, rows=some))
        (claim,) = (c for c in claims if "D-1, D-3" in c.text)
        assert claim.signs == {"x": sign, "y": sign}
        assert not any(s for c in claims if "A → B" in c.text for s in c.signs.values())
        assert not any("ChESS" in c.text for c in claims)


def test_what_cannot_be_told_holds_neither_way():
    (close,) = (c for c in table_claims.claims_of_seeds(two_seeds(0.001)) if "saturates" in c.text)
    assert close.signs == {"F, H": 0}
    (worse,) = (c for c in table_claims.claims_of_seeds(two_seeds(0.01)) if "saturates" in c.text)
    assert worse.signs == {"F, H": -1}
    without_scatter = table_claims.claims_of_seeds(two_seeds(0.01, apart=0.0))
    assert not any(s for c in without_scatter for s in c.signs.values())
    assert not table_claims.claims_of_seeds([r for r in two_seeds(0.01) if "seed 2" not in r["row"]])
    line = next(line for line in table_text.claim_lines("seeds", two_seeds(0.01)) if "D-1, D-3" in line)
    assert "holds on 2 of 2, doesn't on 0, can't be told on 0" in line


def test_rows_become_figures(every_network):
    what = tables.plan("table2", sets=["mesa-like"], most=1)
    rows = tables.table(what, load=knowing(what.sets["mesa-like"]))
    figures = table_claims.measured(rows)
    assert figures.keys() == {(row, m) for row in ("A", "MATE") for m in tables.METHODS}
    assert figures["MATE", "std"] == {"mesa-like": (1.0, 1.0)}


# ---- the commands


def test_the_command_leaves_table_json_csv_and_markdown(tmp_path, monkeypatch):
    monkeypatch.delenv("RCDN_DATA", raising=False)
    files = {name: tmp_path / name for name in ("a.json", "a.csv", "a.md")}
    words = ["table3", "--set", "mesa-like", "--set", "ueye", "--count", 1, "--workers", 1]
    words += ["--json", files["a.json"], "--csv", files["a.csv"], "--markdown", files["a.md"]]
    result = CliRunner().invoke(APP, [str(w) for w in words])
    assert result.exit_code == 0, result.output
    record = json.loads(files["a.json"].read_text())
    assert record["suite"] == "table3"
    assert record["provenance"]["commit"]
    assert record["settings"]["sets"]["mesa-like"]["looked at"] == 1
    assert record["settings"]["networks"]["F"]["sha256"]
    assert record["settings"]["cluster"]["k"] == 10
    line = next(r for r in record["rows"] if (r["row"], r["set"]) == ("F", "mesa-like"))
    assert line["paper recall"] == 0.9992
    assert line["recall difference"] == pytest.approx(line["recall"] - 0.9992, abs=2e-5)
    with files["a.csv"].open() as handle:
        assert [r["row"] for r in csv.DictReader(handle)] == [r["row"] for r in record["rows"]]
    page = files["a.md"].read_text()
    assert page.startswith("## Table 3")
    assert "`rcdn evaluate table3 --set mesa-like --set ueye --count 1`" in page
    assert "| F | adaptive | mesa-like | 1/206 | 0.9997 |" in page
    assert "ueye skipped: photographs" in result.output
    assert "F has the better recall than ChESS" in result.output


def test_table_2_is_a_command_too(every_network):
    result = CliRunner().invoke(APP, ["table2", "--set", "mesa-like", "--count", "1", "--workers", "1"])
    assert result.exit_code == 0, result.output
    assert result.output.count("mesa-like") >= 8
    for text in ("std 0.8", "std 1.7", "0.41 max", "0.57 max", "adaptive"):
        assert text in result.output
