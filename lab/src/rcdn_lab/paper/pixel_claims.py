"""The claims of section 4.2 about Figs. 4 and 5, compared with our rows. Pure functions of the rows of
`pixel_error.table`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rcdn.types import Array
from rcdn_lab.paper.claim import Claim, markdown_claims, markdown_table
from rcdn_lab.paper.pixel_error import ANGLES, CHESS, MATE, RCDN, summary

Row = dict[str, Any]
CLEAR = 2.0
"""standard errors above which a difference is significant"""
STEEP = 60
"""degrees of tilt that count as large"""
SATISFACTORY = 1.0
"""px of mean error"""
NAMED = 8
"""cells that are listed; the others are counted"""


def claims(rows: Sequence[Row]) -> list[Claim]:
    """All claims of the paper about the figure of `rows`, one by one."""
    figure = rows[0]["figure"]
    own = [periodicity(rows)] if figure == "fig4" else [distortion(rows), steep(rows)]
    return [best_everywhere(rows), ranking(rows), *own, pre_blur(rows), fewer_misses(rows)]


def cells(rows: Sequence[Row]) -> list[dict[str, Row]]:
    """The rows of each cell (angle, noise, pre-blur), method → row."""
    out: dict[tuple[Any, ...], dict[str, Row]] = {}
    for row in rows:
        out.setdefault((row["pre-blur"], row[ANGLES[row["figure"]]], row["noise"]), {})[row["method"]] = row
    return list(out.values())


def _others(rows: Sequence[Row]) -> list[str]:
    return [name for name in dict.fromkeys(row["method"] for row in rows) if name != RCDN]


def standing(cell: dict[str, Row]) -> str:
    """RCDN in a cell compared with the best of the others: `beats`, `level` (the same error), `loses` or, if
    significant, `clearly loses`."""
    others = [row for name, row in cell.items() if name != RCDN]
    worse = [row["worse px"] for row in others]
    if min(worse) > 0:
        return "beats"
    if any(row["worse px"] < -CLEAR * row["worse se"] for row in others):
        return "clearly loses"
    return "loses" if min(worse) < 0 else "level"


def not_won(rows: Sequence[Row]) -> list[str]:
    """The cells in which another method's mean error is smaller than RCDN's, those with the largest difference first,
    in words."""
    lost = [cell for cell in cells(rows) if len(cell) > 1 and standing(cell).endswith("loses")]
    return [_name(cell) for cell in sorted(lost, key=lambda cell: min(row["worse px"] for row in cell.values()))]


def best_everywhere(rows: Sequence[Row]) -> Claim:
    """RCDN's mean error compared with each of the others', cell by cell."""
    others = _others(rows)
    text = "RCDN performs better than MATE and ChESS in all experiments"
    if not others:
        return Claim(text, None, "No other method ran")
    every = cells(rows)
    how = [standing(cell) for cell in every]
    count = {name: how.count(name) for name in ("beats", "level", "loses", "clearly loses")}
    both = "both" if len(others) == 2 else others[0]
    found = f"F beats {both} in {count['beats']} of {len(every)} cells, is level with the best in {count['level']}"
    if lost := not_won(rows):
        more = "" if len(lost) <= NAMED else f", … (the {NAMED} largest of {len(lost)})"
        found += f", and loses in {len(lost)} ({count['clearly loses']} beyond chance): {', '.join(lost[:NAMED])}{more}"
    return Claim(text, not lost if {MATE, CHESS} <= set(others) or lost else None, found + _absent(rows))


def _absent(rows: Sequence[Row]) -> str:
    lacking = [name for name in (MATE, CHESS) if name not in _others(rows)]
    return f" ({' and '.join(lacking)} didn't run)" if lacking else ""


def _name(cell: dict[str, Row]) -> str:
    rcdn = cell[RCDN]
    other = min((row for name, row in cell.items() if name != RCDN), key=lambda row: row["mean px"])
    where = f"{rcdn[ANGLES[rcdn['figure']]]}° noise {rcdn['noise']}{' blurred' if rcdn['pre-blur'] else ''}"
    return f"{where} ({rcdn['mean px']:.2f} against {other['method']}'s {other['mean px']:.2f} px)"


def _mean(rows: Sequence[Row], method: str, blurred: bool | None = None) -> float:
    mine = [row["mean px"] for row in rows if row["method"] == method and blurred in (None, row["pre-blur"])]
    return float(np.mean(mine)) if mine else float("nan")


def ranking(rows: Sequence[Row]) -> Claim:
    """Means over the whole figure."""
    means = {name: _mean(rows, name) for name in (RCDN, MATE, CHESS)}
    text = "MATE is slightly worse than RCDN, ChESS performs worst"
    holds = means[RCDN] < means[MATE] < means[CHESS] if not np.isnan([*means.values()]).any() else None
    found = ", ".join(f"{name} {value:.2f} px" for name, value in means.items() if not np.isnan(value))
    return Claim(text, holds, f"Mean over all cells: {found}")


def harmonics(rows: Sequence[Row], method: str) -> Array:
    """Amplitudes, px, of the harmonics of the mean error over noise as a function of rotation, with period 90°: the
    k-th has a period of 90° / k."""
    angles = sorted({row["rotation"] for row in rows if row["rotation"] < 90})
    mine = [row for row in rows if row["method"] == method]
    over = [np.mean([row["mean px"] for row in mine if row["rotation"] == angle]) for angle in angles]
    return np.asarray(2 * np.abs(np.fft.rfft(over)) / len(over))


def chance(rows: Sequence[Row], method: str) -> float:
    """Amplitude, px, of a harmonic of `harmonics` due to the finite number of trials (root mean square)."""
    mine = [row for row in rows if row["method"] == method and row["rotation"] < 90]
    angles = {row["rotation"] for row in mine}
    alike = len({row["pre-blur"] for row in mine})  # pictures without and with pre-blur have the same noise
    variance = sum(row["se px"] ** 2 for row in mine) * alike / len(angles) / (len(mine) / len(angles)) ** 2
    return float(2 * np.sqrt(variance / len(angles)))


def periodicity(rows: Sequence[Row]) -> Claim:
    """ChESS' ring has samples 22.5° apart: the fourth harmonic over 90° and its double, compared with chance."""
    text = "ChESS presents some periodicity due to the angular spacing of the sampling ring (22.5°)"
    if CHESS not in _others(rows):
        return Claim(text, None, "ChESS didn't run")
    size = harmonics(rows, CHESS)[1:]
    if len(size) < 4:
        return Claim(text, None, "Too few angles")
    strongest, by_chance = int(size.argmax()) + 1, chance(rows, CHESS)
    found = f"The period of 22.5° has ±{size[3]:.3f} px of mean error (chance: ±{by_chance:.3f} px)"
    if strongest != 4:
        found += f"; the strongest over 90° is {90 / strongest:.3g}° with ±{size.max():.3f} px"
    return Claim(text, bool(size[3] > CLEAR * by_chance) and strongest in (4, 8), found)


def _at(rows: Sequence[Row], method: str, steep_too: bool) -> float:
    """Mean error at a tilt of 0, or of at least `STEEP`."""
    return _mean([row for row in rows if (row["tilt"] >= STEEP if steep_too else row["tilt"] == 0)], method)


def distortion(rows: Sequence[Row]) -> Claim:
    """Increase of the mean error from no tilt to a large one."""
    text = "MATE has the similar response distribution but is more sensitive to the distortion"
    if MATE not in _others(rows):
        return Claim(text, None, "MATE didn't run")
    grown = {name: _at(rows, name, True) - _at(rows, name, False) for name in (RCDN, MATE)}
    found = (
        f"From 0° to {STEEP}° and more, MATE's mean error grows by {grown[MATE]:.2f} px, RCDN's by {grown[RCDN]:.2f} px"
    )
    return Claim(text, grown[MATE] > grown[RCDN], found)


def steep(rows: Sequence[Row]) -> Claim:
    """ChESS at a large tilt, compared with the others."""
    text = "ChESS fares worst and cannot get satisfactory results as the skew angle increases"
    if CHESS not in _others(rows):
        return Claim(text, None, "ChESS didn't run")
    means = {name: _at(rows, name, True) for name in dict.fromkeys(row["method"] for row in rows)}
    worst = means[CHESS] == max(means.values())
    found = f"At {STEEP}° and more: {', '.join(f'{name} {value:.2f} px' for name, value in means.items())}"
    found += f"; ChESS without tilt {_at(rows, CHESS, False):.2f} px"
    return Claim(text, worst and means[CHESS] > max(SATISFACTORY, _at(rows, CHESS, False)), found)


def pre_blur(rows: Sequence[Row]) -> Claim:
    """Mean absolute change of a cell's error by the pre-blur."""
    text = "RCDN performs almost the same with the pre-blur and without, unlike MATE and ChESS"
    names = list(dict.fromkeys(row["method"] for row in rows))
    change = {}
    for name in names:
        mine = [row for row in rows if row["method"] == name]
        sharp, soft = ([row["mean px"] for row in mine if row["pre-blur"] is b] for b in (False, True))
        change[name] = float(np.mean(np.abs(np.subtract(sharp, soft))))
    found = "Mean change of a cell: " + ", ".join(f"{name} {value:.3f} px" for name, value in change.items())
    others = [change[name] for name in names if name != RCDN]
    return Claim(text, change[RCDN] < min(others) if len(others) == 2 else None, found + _absent(rows))


def fewer_misses(rows: Sequence[Row]) -> Claim:
    """Misses compared with ChESS, cell by cell."""
    text = "RCDN misses no more corners than ChESS in any cell"
    if CHESS not in _others(rows):
        return Claim(text, None, "ChESS didn't run", ours=True)
    every = cells(rows)
    more = [cell for cell in every if cell[RCDN]["miss"] > cell[CHESS]["miss"]]
    shares = [float(np.mean([cell[name]["miss"] for cell in every])) for name in (RCDN, CHESS)]
    found = (
        f"It misses more in {len(more)} of {len(every)} cells; in all RCDN misses {shares[0]:.1%}, "
        f"ChESS {shares[1]:.1%}"
    )
    return Claim(text, not more, found, ours=True)


def markdown(rows: Sequence[Row]) -> str:
    """Short tables: mean error over the angles by noise, and the paper's claims."""
    short = [row for row in summary(rows) if row["noise"] % 20 == 0]
    noises = list(dict.fromkeys(row["noise"] for row in short))
    body = []
    for method, blurred in dict.fromkeys((row["method"], row["pre-blur"]) for row in short):
        mine = {row["noise"]: row for row in short if (row["method"], row["pre-blur"]) == (method, blurred)}
        name = method + (", pre-blur" if blurred else "")
        body.append([name, *(f"{mine[n]['mean px']:.2f} ({100 * mine[n]['miss']:.0f} %)" for n in noises)])
    over = ANGLES[rows[0]["figure"]]
    table = markdown_table([f"mean px over {over} (misses)", *(f"noise {n}" for n in noises)], body)
    return f"{table}\n\n{markdown_claims(claims(rows))}\n"
