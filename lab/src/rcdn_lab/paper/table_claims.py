"""The claims of section 4.1 about its Tables 2 and 3, checked one by one on the paper's own figures and on ours."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from scipy.stats import t as student

from rcdn_lab.paper.networks import TWICE
from rcdn_lab.paper.published import CROSS_ENTROPY, TABLE2, TABLE3

CLOSE = 0.005
"""difference of F1 up to which thresholds count as close"""
NEARLY_ALL = 0.75
"""share of the comparisons that counts as "nearly all" of them"""
Key = tuple[str, str]
"""row of a network, threshold method"""
Figures = Mapping[Key, Mapping[str, tuple[float, float]]]
"""key → set → precision and recall"""
Measure = Callable[[tuple[float, float]], float]
Least = Callable[[Measure, str], float]
"""measure, set (or '': the mean of all) → the smallest difference of two rows that counts"""
LEVEL = 0.95
"""confidence at which two rows of two seeds each are said to differ"""


@dataclass(frozen=True)
class Comparison:
    """A claim that compares figures, with the result: `signs`: case → 1 it holds, 0 both are equal, −1 it does not;
    `details`: the figures.

    `share`: share of the cases in which it must hold; None: in all, some of which may be equal.
    """

    text: str
    signs: Mapping[str, int]
    details: str
    share: float | None = None

    @property
    def verdict(self) -> str:
        """`holds`, `holds on k of n`, `doesn't hold`, `equal`, or `not checked`."""
        yes, no, every = (sum(s == k for s in self.signs.values()) for k in (1, -1, 0))
        every += yes + no
        if not every:
            return "not checked"
        if self.share is not None:
            enough = yes >= self.share * every
            return ("holds" if enough else "doesn't hold") + f" ({yes} of {every})"
        if yes and not no:
            return "holds"
        if yes:
            return f"holds on {yes} of {every}"
        return "doesn't hold" if no else "equal"


def f1(rates: tuple[float, float]) -> float:
    """Harmonic mean of precision and recall."""
    return 2 * rates[0] * rates[1] / max(sum(rates), 1e-12)


def precision(rates: tuple[float, float]) -> float:
    return rates[0]


def recall(rates: tuple[float, float]) -> float:
    return rates[1]


def measured(rows: Sequence[Mapping[str, Any]]) -> Figures:
    """The figures of a table's rows, by the paper's definition; rows that were skipped have none."""
    out: dict[Key, dict[str, tuple[float, float]]] = {}
    for row in rows:
        if row["precision"] is not None:
            out.setdefault((row["row"], row["method"]), {})[row["set"]] = (row["precision"], row["recall"])
    return out


def published(table: str) -> Figures:
    """The paper's own figures."""
    if table == "table2":
        return {("A" if net == CROSS_ENTROPY else "MATE", method): rates for (net, method), rates in TABLE2.items()}
    return {(row, "max" if row == "ChESS" else "adaptive"): rates for row, rates in TABLE3.items()}


def claims(table: str, figures: Figures) -> list[Comparison]:
    """The claims about `table2` or `table3`, on these figures. F1 is used for "better" where the text does not specify
    the measure."""
    return _of_table2(figures) if table == "table2" else _of_table3(figures)


# ---- comparisons


def _sign(a: float, b: float, least: float = 0.0) -> int:
    """Sign of a − b, in the digits that the tables show; 0 if they differ by less than `least`."""
    if abs(a - b) < least:
        return 0
    return (round(a, 5) > round(b, 5)) - (round(a, 5) < round(b, 5))


def _no_worse(a: float, b: float, least: float) -> int:
    """1 if a is at least b, else −1; 0 if they differ by less than `least`."""
    return _sign(a, b, least) or int(not least)


def _any(measure: Measure, name: str) -> float:
    """Every difference counts."""
    return 0.0


def _common(figures: Figures, *keys: Key) -> list[str]:
    """Sets on which all of `keys` were measured."""
    return [name for name in figures.get(keys[0], {}) if all(name in figures.get(k, {}) for k in keys)]


def _name(key: Key, methods: bool) -> str:
    return f"{key[0]} {key[1]}" if methods else key[0]


def _better(
    text: str, figures: Figures, pairs: Sequence[tuple[Key, Key]], measure: Measure, share: float | None = None,
    only: str = "", least: Least = _any,
) -> Comparison:  # fmt: skip
    """The first of each pair is greater on every set (or on those whose name contains `only`)."""
    signs, details = {}, []
    for one, two in pairs:
        methods = len(pairs) > 1 or one[0] == two[0]
        for name in _common(figures, one, two):
            if only not in name.lower():
                continue
            a, b = measure(figures[one][name]), measure(figures[two][name])
            where = f"{name}, {_name(one, True)}" if len(pairs) > 1 else name
            signs[where] = _sign(a, b, least(measure, name))
            details.append(f"{name}: {_name(one, methods)} {a:.4f}, {_name(two, methods)} {b:.4f}")
    return Comparison(text, signs, "; ".join(details), share)


def _of_table2(figures: Figures) -> list[Comparison]:
    nets = ("A", "MATE")

    def pairs(one: str, two: str) -> list[tuple[Key, Key]]:
        return [((net, one), (net, two)) for net in nets]

    losses = [(("A", m), ("MATE", m)) for m in ("0.5", "std", "max", "adaptive")]
    return [
        _better(
            "0.5 has the lower precision than the adaptive threshold", figures, pairs("adaptive", "0.5"), precision
        ),
        _better("0.5 has the higher recall than the adaptive threshold", figures, pairs("0.5", "adaptive"), recall),
        _better("the Std-threshold is worse than 0.5 (F1)", figures, pairs("0.5", "std"), f1),
        _better(
            "on GoPro the Std-threshold has the lower precision than 0.5",
            figures,
            pairs("0.5", "std"),
            precision,
            only="gopro",
        ),
        _best(figures, nets),
        _close(figures, nets),
        _better("cross entropy is better than MSE for nearly all thresholds (F1)", figures, losses, f1, NEARLY_ALL),
    ]


def _best(figures: Figures, nets: Sequence[str]) -> Comparison:
    signs, details = {}, []
    for net in nets:
        keys = [(net, m) for m in ("max", "0.5", "std", "adaptive")]
        for name in _common(figures, *keys):
            values = [f1(figures[k][name]) for k in keys]
            signs[f"{name}, {net}"] = _sign(values[0], max(values[1:]))
            details.append(f"{name}: {net} max {values[0]:.4f}, best other {max(values[1:]):.4f}")
    return Comparison(
        "a share of the maximum is the best threshold on two data sets of three (F1)", signs, "; ".join(details), 2 / 3
    )


def _close(figures: Figures, nets: Sequence[str]) -> Comparison:
    signs, details = {}, []
    for net in nets:
        for name in _common(figures, (net, "adaptive"), (net, "max")):
            a, b = f1(figures[net, "adaptive"][name]), f1(figures[net, "max"][name])
            signs[f"{name}, {net}"] = 1 if abs(a - b) <= CLOSE else -1
            details.append(f"{name}: {net} adaptive {a:.4f}, max {b:.4f}")
    return Comparison(
        f"the adaptive threshold is close to a share of the maximum (F1 within {CLOSE})", signs, "; ".join(details)
    )


def _of_table3(figures: Figures, least: Least = _any) -> list[Comparison]:
    def net(row: str) -> Key:
        return row, "max" if row == "ChESS" else "adaptive"

    def better(text: str, one: str, two: str, measure: Measure = f1) -> Comparison:
        return _better(text, figures, [(net(one), net(two))], measure, least=least)

    return [
        better("one large first kernel is better than a stack of small ones (B, C; F1)", "B", "C"),
        better("small hidden kernels have the better precision (H, G)", "H", "G", precision),
        better("a last layer of 1×1 is better than of 3×3 (D-1, D-3; F1)", "D-1", "D-3"),
        better("a 1×1 layer that fuses helps (A → B; F1)", "B", "A"),
        better("a 1×1 layer that fuses helps (E-32 → F; F1)", "F", "E-32"),
        *_depth(figures, least),
        *(
            better(f"F has the better {what} than {other}", "F", other, measure)
            for what, measure in (("recall", recall), ("precision", precision))
            for other in ("MATE", "ChESS")
        ),
    ]


def _depth(figures: Figures, least: Least) -> list[Comparison]:
    """By the mean F1 of the sets: increasing from three to six layers, and not further with a seventh."""
    rows = ("A", "D-1", "E-32", "F", "H")
    names = _common(figures, *((row, "adaptive") for row in rows))
    texts = (
        "accuracy grows with depth (A, D-1, E-32, F: 3 to 6 layers; mean F1)",
        "and saturates with F (H, 7 layers, is no better; mean F1)",
    )
    if not names:
        return [Comparison(text, {}, "") for text in texts]
    mean = {row: sum(f1(figures[row, "adaptive"][name]) for name in names) / len(names) for row in rows}
    steps = {f"{a} → {b}": _sign(mean[b], mean[a], least(f1, "")) for a, b in pairwise(rows[:4])}
    rising = ", ".join(f"{row} {mean[row]:.4f}" for row in rows[:4])
    last = f"F {mean['F']:.4f}, H {mean['H']:.4f}"
    return [
        Comparison(texts[0], steps, rising),
        Comparison(texts[1], {"F, H": _no_worse(mean["F"], mean["H"], least(f1, ""))}, last),
    ]


# ---- two seeds


def claims_of_seeds(rows: Sequence[Mapping[str, Any]]) -> list[Comparison]:
    """The claims about Table 3 on the means of two seeds (`networks.TWICE`), on the sets that all networks saw. A
    difference of two rows counts if Student's t calls it significant at `LEVEL`, by the scatter of all networks' seeds
    on the same set, which is taken to be the same for all; otherwise its sign is 0. Claims about ChESS, which isn't
    trained, are left out."""
    figures = measured(rows)
    both = {
        row: (figures[one, "adaptive"], figures[two, "adaptive"])
        for row, (one, two) in TWICE.items()
        if (one, "adaptive") in figures and (two, "adaptive") in figures
    }
    if not both:
        return []
    sets = _common(figures, *((name, "adaptive") for row in both for name in TWICE[row]))
    t = float(student.ppf((1 + LEVEL) / 2, len(both)))  # one degree of freedom a network

    def value(one: Mapping[str, tuple[float, float]], measure: Measure, name: str) -> float:
        return measure(one[name]) if name else sum(measure(one[n]) for n in sets) / len(sets)

    def least(measure: Measure, name: str) -> float:
        squares = [(value(one, measure, name) - value(two, measure, name)) ** 2 / 2 for one, two in both.values()]
        sigma = math.sqrt(sum(squares) / len(squares))  # also that of the difference of two means of two
        return t * sigma or math.inf  # without scatter nothing can be told

    means = {
        (row, "adaptive"): {n: ((one[n][0] + two[n][0]) / 2, (one[n][1] + two[n][1]) / 2) for n in sets}
        for row, (one, two) in both.items()
    }
    return [claim for claim in _of_table3(means, least) if claim.signs]
