"""The claims of section 4.3 about its figure, compared with our rows. Pure functions of the rows of
`refinements.table`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from rcdn_lab.paper.claim import Claim, folded, markdown_claims, markdown_table
from rcdn_lab.paper.refinements import FACTORS, INTENSITY, METHODS, MIXED, OURS, RESPONSE

Row = dict[str, Any]
PAPER = (*RESPONSE, *INTENSITY, *MIXED)
MIX, FIRST = next(iter(MIXED)), next(iter(OURS))
CLOSE = 0.01
"""px by which "mixed" may be worse than the intensity methods over blur"""
STABLE = 0.05
"""largest range of a stable error, px"""
SPIKE = 3.0
"""× the median over rotation"""
SHOWN = {
    "noise": (0, 10, 20, 40, 60, 80, 100),
    "blur": (0, 1, 2, 3, 4, 6),
    "rotation": (0, 15, 30, 45, 90),
    "tilt": (0, 30, 50, 60, 70),
}
UNITS = {"noise": "", "blur": " px", "rotation": "°", "tilt": "°"}


class Curves:
    """Mean errors, px, of one factor: `levels`, and method → error at each of them."""

    def __init__(self, rows: Sequence[Row], factor: str) -> None:
        mine = [row for row in rows if row["factor"] == factor]
        self.factor = factor
        self.levels: list[float] = list(dict.fromkeys(row["level"] for row in mine))
        at = {(row["method"], row["level"]): row["mean px"] for row in mine}
        names = dict.fromkeys(row["method"] for row in mine)
        self.of = {name: np.array([at[name, level] for level in self.levels], float) for name in names}

    def growth(self, name: str) -> float:
        """Increase from the first level to the last."""
        return float(self.of[name][-1] - self.of[name][0])

    def span(self, name: str) -> float:
        return float(np.ptp(self.of[name]))


def claims(rows: Sequence[Row]) -> list[Claim]:
    """All claims of the paper about the factors in `rows`, one by one, and our requirements on "mixed" and on our
    methods."""
    out: list[Claim] = []
    for factor, checks in CHECKS.items():
        if any(row["factor"] == factor for row in rows):
            curves = Curves(rows, factor)
            out += [check(curves) for check in checks]
    return [*out, intensity_first(rows)]


def lowest(curves: Curves, name: str, among: Iterable[str] = PAPER) -> list[float]:
    """Levels at which the mean error of `name` is below that of all the other methods `among`."""
    others = np.min([curves.of[other] for other in among if other != name], axis=0)
    return [level for level, best in zip(curves.levels, curves.of[name] < others, strict=True) if best]


def _least(curves: Curves, name: str) -> str:
    """In words: the number of levels at which it is the lowest, and the others with the lowest of the paper's
    methods."""
    best = lowest(curves, name)
    table = np.array([curves.of[other] for other in PAPER])
    gap = [
        f"{level:g}{UNITS[curves.factor]} ({PAPER[int(row.argmin())]} {row.min():.3f}, {name} {own:.3f})"
        for level, row, own in zip(curves.levels, table.T, curves.of[name], strict=True)
        if level not in best
    ]
    return f"Lowest of the six at {len(best)} of {len(curves.levels)} levels" + (
        f"; not at {', '.join(gap)}" if gap else ""
    )


def _figures(names: Iterable[str], value: Callable[[str], float]) -> str:
    return ", ".join(f"{name} {value(name):.3f}" for name in names)


def lowest_over_noise(curves: Curves) -> Claim:
    holds = len(lowest(curves, MIX)) == len(curves.levels)
    return Claim("Noise: mixed keeps the lowest errors", holds, _least(curves, MIX))


def slowest_over_noise(curves: Curves) -> Claim:
    others = min(curves.growth(name) for name in PAPER if name != MIX)
    return Claim(
        "Noise: mixed has the slowest increase", curves.growth(MIX) < others,
        f"Increase over the range, px: {_figures(PAPER, curves.growth)}",
    )  # fmt: skip


def diverging(curves: Curves) -> Claim:
    """Growth of the errors over noise."""
    growth = {name: curves.growth(name) for name in PAPER}
    faster = min(growth[name] for name in INTENSITY) > max(growth[name] for name in RESPONSE)
    return Claim(
        "Noise: intensity methods diverge sharply, especially edge approximation",
        faster and max(growth, key=growth.__getitem__) == "OpenCV",
        f"Increase over the range, px: {_figures([*INTENSITY, *RESPONSE], curves.growth)}",
    )  # fmt: skip


def late(curves: Curves) -> Claim:
    """Response methods at the lowest and the highest noise."""
    first = {name: float(curves.of[name][0]) for name in PAPER}
    slower = max(curves.growth(name) for name in RESPONSE) < min(curves.growth(name) for name in INTENSITY)
    higher = min(first[name] for name in RESPONSE) > max(first[name] for name in INTENSITY)
    return Claim(
        "Noise: response methods have higher errors at first but increase slowly", higher and slower,
        f"At the lowest noise, px: {_figures([*RESPONSE, *INTENSITY], first.__getitem__)}; "
        f"they increase more slowly: {'yes' if slower else 'no'}",
    )  # fmt: skip


def stable(curves: Curves) -> Claim:
    """Range of the errors over blur."""
    spans = {name: curves.span(name) for name in PAPER}
    return Claim(
        "Blur: all methods keep stable", max(spans.values()) <= STABLE,
        f"Largest − smallest mean error, px (stable: at most {STABLE}): {_figures(PAPER, spans.__getitem__)}",
    )  # fmt: skip


def above_response(curves: Curves) -> Claim:
    best = np.array(lowest(curves, MIX, [MIX, *RESPONSE]))
    gain = np.mean(np.min([curves.of[name] for name in RESPONSE], axis=0) - curves.of[MIX])
    return Claim(
        "Blur: mixed excels the response methods largely", len(best) == len(curves.levels),
        f"Lower than all three at {len(best)} of {len(curves.levels)} levels; "
        f"by {gain:.3f} px on average than the best of them",
    )  # fmt: skip


def close_to_intensity(curves: Curves) -> Claim:
    """Difference over blur from the better of the two intensity methods."""
    gap = curves.of[MIX] - np.min([curves.of[name] for name in INTENSITY], axis=0)
    near = int((gap <= CLOSE).sum())
    worst = int(gap.argmax())
    return Claim(
        f"Blur: mixed is within {CLOSE} px of the intensity methods", near == len(gap),
        f"At {near} of {len(gap)} levels; at most {gap[worst]:+.3f} px, at {curves.levels[worst]:g} px of blur",
    )  # fmt: skip


def ripple(curves: Curves) -> Claim:
    """Range of the errors over rotation."""
    spans = {name: curves.span(name) for name in PAPER}
    more = min(spans[name] for name in RESPONSE) > max(spans[name] for name in INTENSITY)
    return Claim(
        "Rotation: the periodicity is distinct for response methods", more,
        f"Largest − smallest mean error, px: {_figures([*RESPONSE, *INTENSITY], spans.__getitem__)}",
    )  # fmt: skip


def surface_beats_edges(curves: Curves) -> Claim:
    """The surface fit compared with cornerSubPix over rotation, except at 45°."""
    levels = [level for level in curves.levels if level != 45]
    best = [level for level in lowest(curves, "ROCHADE", INTENSITY) if level != 45]
    means = {name: float(curves.of[name].mean()) for name in INTENSITY}
    return Claim(
        "Rotation: surface fitting performs better than edge approximation", len(best) == len(levels),
        f"At {len(best)} of {len(levels)} angles; mean, px: {_figures(INTENSITY, means.__getitem__)}",
    )  # fmt: skip


def spike(curves: Curves) -> Claim:
    """The surface fit at 45° compared with its median."""
    text = "Rotation: surface fitting gets an extremely large error at 45°"
    if 45 not in curves.levels:
        return Claim(text, None, "No pictures at 45°")
    own = curves.of["ROCHADE"]
    at, typical = float(own[curves.levels.index(45)]), float(np.median(own))
    return Claim(text, at > SPIKE * typical, f"{at:.3f} px at 45°, median over all angles {typical:.3f} px")


def best_over_rotation(curves: Curves) -> Claim:
    holds = len(lowest(curves, MIX)) == len(curves.levels)
    return Claim("Rotation: mixed gets the best result at all angles", holds, _least(curves, MIX))


def resilient(curves: Curves) -> Claim:
    """Growth of the errors over tilt."""
    strong = [*INTENSITY, MIX]
    holds = max(curves.growth(name) for name in strong) < min(curves.growth(name) for name in RESPONSE)
    return Claim(
        "Tilt: mixed is similar to the intensity methods, all more resilient than the response methods", holds,
        f"Increase over the range, px: {_figures([*strong, *RESPONSE], curves.growth)}",
    )  # fmt: skip


def parts(curves: Curves) -> Claim:
    """Comparison of the mean of two methods with each of them."""
    mine, parents = curves.of[MIX], np.array([curves.of[name] for name in ("ROCHADE", "Gauss")])
    above, below = int((mine < parents.min(axis=0)).sum()), int((mine > parents.max(axis=0)).sum())
    return Claim(
        f"{curves.factor.capitalize()}: mixed is better than both of its parts", above == len(mine),
        f"Better than both at {above}, between them at {len(mine) - above - below}, worse than both at {below} of "
        f"{len(mine)} levels; {np.median(mine / parents.min(axis=0)):.2f} × the better part (median)",
        ours=True,
    )  # fmt: skip


def ours(curves: Curves) -> Claim:
    """The first refinement of `auto` compared with the paper's six."""
    best = lowest(curves, FIRST, [FIRST, *PAPER])
    six = np.min([curves.of[name] for name in PAPER], axis=0)
    found = (
        f"At {len(best)} of {len(curves.levels)} levels; "
        f"{np.median(curves.of[FIRST] / six):.2f} × the best of the six (median)"
    )
    return Claim(
        f"{curves.factor.capitalize()}: the first refinement of auto is better than all six",
        len(best) == len(curves.levels),
        found,
        ours=True,
    )


def intensity_first(rows: Sequence[Row]) -> Claim:
    """All levels of all factors together, except noise."""
    text = "All in all, intensity methods perform better than response methods"
    quiet = [
        Curves(rows, factor) for factor in FACTORS if factor != "noise" and any(row["factor"] == factor for row in rows)
    ]
    if not quiet:
        return Claim(text, None, "Noise alone can't tell")
    means = {name: float(np.mean(np.concatenate([c.of[name] for c in quiet]))) for name in PAPER}
    holds = max(means[name] for name in INTENSITY) < min(means[name] for name in RESPONSE)
    return Claim(text, holds, f"Mean over blur, rotation and tilt, px: {_figures(PAPER, means.__getitem__)}")


CHECKS: dict[str, tuple[Callable[[Curves], Claim], ...]] = {
    "noise": (lowest_over_noise, slowest_over_noise, diverging, late, parts, ours),
    "blur": (stable, above_response, close_to_intensity, parts, ours),
    "rotation": (ripple, surface_beats_edges, spike, best_over_rotation, parts, ours),
    "tilt": (resilient, parts, ours),
}


def summary(rows: Sequence[Row]) -> list[Row]:
    """A row for each level, a column for each method: mean errors, px, with the share of failures (in %) if there are
    any."""
    out: list[Row] = []
    for factor, level in dict.fromkeys((row["factor"], row["level"]) for row in rows):
        mine = {row["method"]: row for row in rows if (row["factor"], row["level"]) == (factor, level)}
        out.append({"factor": factor, "level": f"{level:g}"} | {name: _cell(row) for name, row in mine.items()})
    return out


def _cell(row: Row) -> str:
    if row["mean px"] is None:
        return "-"
    failed = f" ({100 * row['failed']:.0f} %)" if row["failed"] >= 0.005 else ""
    return f"{row['mean px']:.3f}{failed}"


def markdown(rows: Sequence[Row]) -> str:
    """The claims and, folded, short tables: a few levels of each factor."""
    out = []
    for factor in dict.fromkeys(row["factor"] for row in rows):
        levels = [
            level
            for level in dict.fromkeys(r["level"] for r in rows if r["factor"] == factor)
            if level in SHOWN[factor]
        ]
        at = {(row["method"], row["level"]): _cell(row) for row in rows if row["factor"] == factor}
        body = [[name, *(at[name, level] for level in levels)] for name in METHODS if (name, levels[0]) in at]
        out.append(
            markdown_table([f"{factor}: mean px (failed)", *(f"{level:g}{UNITS[factor]}" for level in levels)], body)
        )
    return "\n\n".join([markdown_claims(claims(rows)), folded("Mean errors, a few levels of each factor", *out)]) + "\n"
