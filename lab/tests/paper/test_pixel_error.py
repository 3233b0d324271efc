"""Figs. 4 and 5: detectors with known answers, the middle of a response, rows, claims."""

import json

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from rcdn.corners.response import load_model
from rcdn.errors import ConfigError, RcdnError
from rcdn_lab.cli.evaluate import figures
from rcdn_lab.paper import pixel_claims, pixel_error
from rcdn_lab.paper.corner_pictures import View, exposure, noisy
from rcdn_lab.paper.middle_response import middle_response
from rcdn_lab.paper.pixel_error import CHESS, MATE, RCDN, REGION

SMALL = pixel_error.Grid("fig4", (0, 30), (0, 40), 3)


def peak_at(x, y):
    response = np.zeros((REGION, REGION), np.float32)
    response[REGION // 2 + y, REGION // 2 + x] = 1
    return response


def test_answers_are_judged():
    assert pixel_error.judge(peak_at(0, 0)) == (0, 1, 0)
    assert pixel_error.judge(peak_at(0, -1)) == (1, 1, 0)
    assert pixel_error.judge(peak_at(3, 4)) == (5, 0, 1)
    assert pixel_error.judge(peak_at(4, 0)) == (4, 0, 0)


def test_several_highest_pixels_share_the_answer():
    assert pixel_error.judge(peak_at(0, 0) + peak_at(6, 0)) == (3, 0.5, 0.5)


def test_no_answer_is_a_miss_and_a_blind_guess():
    error, hit, miss = pixel_error.judge(np.zeros((REGION, REGION)))
    assert (hit, miss) == (0, 1)
    assert error == pytest.approx(0.3826 * REGION, rel=0.01)  # mean distance of a square's points from its middle


@pytest.mark.parametrize(
    ("model", "low", "high"), [("paper", 20, 61), ("auto", 20, 61), ("auto", 23, 50), ("paper", 3, 81)]
)
def test_the_middle_is_that_of_the_whole_response(model, low, high):
    """Whatever the normalisation, cells and margins of the network."""
    loaded = load_model(model)
    grey = noisy(exposure(View(30, gap=1.0), 81), 20, np.random.default_rng(3))
    whole = loaded(grey)
    assert whole.max() > 0.3
    assert middle_response(loaded, grey, low, high) == pytest.approx(whole[low:high, low:high], abs=1e-5)


def test_a_middle_outside_the_picture_is_told():
    with pytest.raises(RcdnError, match="<= 81, not 20 and 90"):
        middle_response(load_model("paper"), np.zeros((81, 81), np.uint8), 20, 90)


def fake(monkeypatch, **responders):
    monkeypatch.setattr(pixel_error, "responder", lambda method, weights: responders[method])
    return dict.fromkeys(responders, "")


def test_rows_of_detectors_with_known_answers(monkeypatch):
    methods = fake(
        monkeypatch,
        RCDN=lambda g: peak_at(0, 0),
        MATE=lambda g: peak_at(0, 2),
        ChESS=lambda g: np.zeros((REGION, REGION)),
    )
    rows = pixel_error.table(SMALL, methods)
    assert len(rows) == 2 * 2 * 2 * 3
    for row in rows:
        assert row["trials"] == (3 if row["noise"] else 1)
        expected = {RCDN: (0, 1, 0), MATE: (2, 0, 0), CHESS: (pytest.approx(15.7, abs=0.1), 0, 1)}
        assert (row["mean px"], row["hit"], row["miss"]) == expected[row["method"]]
        assert row["worse px"] == row["mean px"]
        assert row["worse se"] == pytest.approx(0, abs=1e-9)


def test_all_methods_see_the_same_pictures_with_the_corner_in_the_middle(monkeypatch):
    seen = {RCDN: [], MATE: []}
    methods = fake(
        monkeypatch, **{name: lambda g, mine=mine: (mine.append(g), peak_at(0, 0))[1] for name, mine in seen.items()}
    )
    pixel_error.table(SMALL, methods)
    assert all(np.array_equal(a, b) for a, b in zip(seen[RCDN], seen[MATE], strict=True))
    noisy_ones = [g for g in seen[RCDN] if len(np.unique(g)) > 200]
    assert len({g.tobytes() for g in noisy_ones}) == len(noisy_ones) == 2 * 2 * 3
    clean = seen[RCDN][0]
    assert clean.shape == (81, 81)
    assert np.array_equal(clean, clean[::-1, ::-1])


def test_the_rows_are_the_same_again_and_whatever_the_workers():
    methods, _ = pixel_error.contestants("paper", "auto")
    one, again, two = (pixel_error.table(SMALL, methods, workers) for workers in (1, 1, 2))
    assert one == again == two
    assert all(row["mean px"] <= 0.5 for row in one if row["method"] == RCDN)


def test_pictures_of_the_quick_run_are_the_first_of_the_full_one():
    few, many = (pixel_error.Cell("fig4", 20, 50, trials, ()) for trials in (10, 1000))
    clean = np.full((81, 81), 100.0)
    assert np.array_equal(pixel_error.pictures(few, 4, clean), pixel_error.pictures(many, 4, clean))


def test_grids_are_the_papers():
    assert len(pixel_error.grid("fig4").angles) == 19
    assert len(pixel_error.grid("fig5").angles) == 15
    full = pixel_error.grid("fig5", full=True)
    assert (len(full.noises), len(full.angles), full.trials) == (101, 71, 1000)
    with pytest.raises(ConfigError, match="fig4, fig5"):
        pixel_error.grid("fig6")


def test_missing_weights_are_a_skipped_method():
    found, lacking = pixel_error.contestants("paper", "tables/nothing")
    assert list(lacking) == [MATE]
    assert "no weights" in lacking[MATE]
    assert next(iter(found)) == RCDN


def rows_of(errors, figure="fig4", blurs=(False, True)):
    """Rows of one noise; `errors`: method → function of (angle, blurred) → mean px."""
    name = pixel_error.ANGLES[figure]
    return [
        {
            "figure": figure, name: a, "noise": 50, "pre-blur": b, "method": method, "mean px": float(of(a, b)),
            "se px": 0.1, "miss": 0.0, "hit": 0.0, "worse px": float(of(a, b) - errors[RCDN](a, b)), "worse se": 0.1,
        }
        for b in blurs for a in range(0, pixel_error.LARGEST[figure] + 1, 5) for method, of in errors.items()
    ]  # fmt: skip


def test_claims_hold_where_the_figures_are_the_papers():
    like = {
        RCDN: lambda a, b: 0.2, MATE: lambda a, b: 0.4 + 0.1 * b,
        CHESS: lambda a, b: 3 + 0.5 * b + np.cos(np.deg2rad(16 * a)),
    }  # fmt: skip
    assert [claim.holds for claim in pixel_claims.claims(rows_of(like))] == [True] * 5
    like[MATE] = lambda a, b: 0.4 + 0.1 * b + a / 100
    like[CHESS] = lambda a, b: 2 + 0.5 * b + a / 10
    assert [claim.holds for claim in pixel_claims.claims(rows_of(like, "fig5"))] == [True] * 6


def test_claims_fail_where_the_figures_say_otherwise():
    like = {
        RCDN: lambda a, b: 0.5 + 0.3 * b + a / 100, MATE: lambda a, b: 0.4 if a == 60 else 2.0,
        CHESS: lambda a, b: 0.6 + np.cos(np.deg2rad(4 * a)) / 2 + a / 100,
    }  # fmt: skip
    best, order, period, blur, _ = pixel_claims.claims(rows_of(like))
    assert not any(claim.holds for claim in (best, order, period, blur))
    assert "60° noise 50 blurred (1.40 against MATE's 0.40 px)" in best.found
    assert "the strongest over 90° is 90°" in period.found
    best, order, sensitive, steep, *_ = pixel_claims.claims(rows_of(like, "fig5"))
    assert not any(claim.holds for claim in (best, order, sensitive, steep))


def test_a_period_is_one_only_above_chance():
    angles = np.arange(0, 90, 5)
    rng = np.random.default_rng(2)
    flat = [
        {"figure": "fig4", "rotation": int(a), "noise": 10 * n, "pre-blur": b, "method": CHESS, "se px": 0.2,
         "mean px": 1 + 0.2 * rng.standard_normal()}
        for a in angles for n in range(11) for b in (False, True)
    ]  # fmt: skip
    ripples = pixel_claims.harmonics(flat, CHESS)[1:9]
    by_chance = pixel_claims.chance(flat, CHESS) / np.sqrt(2)  # here the pre-blurred have a noise of their own
    assert np.sqrt(np.mean(ripples**2)) == pytest.approx(by_chance, rel=0.5)


def test_level_cells_are_neither_won_nor_lost():
    rows = rows_of({RCDN: lambda a, b: 1, MATE: lambda a, b: 1 if a < 10 else 2, CHESS: lambda a, b: 2})
    claim = pixel_claims.best_everywhere(rows)
    assert claim.holds
    assert "beats both in 34 of 38 cells, is level with the best in 4" in claim.found
    assert pixel_claims.not_won(rows) == []


def test_what_did_not_run_is_not_checked():
    rows = rows_of({RCDN: lambda a, b: 1, CHESS: lambda a, b: 2})
    best, order, *_ = pixel_claims.claims(rows)
    assert best.holds is order.holds is None
    assert "MATE didn't run" in best.found


def test_the_command_leaves_table_json_csv_markdown_and_plot(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib", reason="plots need matplotlib")
    monkeypatch.setattr(pixel_error, "grid", lambda figure, full, trials: pixel_error.Grid(figure, (0, 60), (0, 20), 2))
    app = typer.Typer()
    app.command()(figures.fig5)
    files = {end: tmp_path / f"a.{end}" for end in ("json", "csv", "md")}
    result = CliRunner().invoke(app, [
        "--mate", "tables/nothing", "--workers", "1", "--json", str(files["json"]), "--csv", str(files["csv"]),
        "--markdown", str(files["md"]), "--plots", str(tmp_path),
    ])  # fmt: skip
    assert result.exit_code == 0, result.output
    assert "skipped MATE" in result.output
    record = json.loads(files["json"].read_text())
    assert record["settings"]["weights"][RCDN]["name"] == "paper"
    assert {row["tilt"] for row in record["rows"]} == {0, 60}
    assert len(files["csv"].read_text().splitlines()) == len(record["rows"]) + 1
    assert "| RCDN, pre-blur |" in files["md"].read_text()
    assert (tmp_path / "fig5.png").stat().st_size > 10_000
