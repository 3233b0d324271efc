"""The paper's Table 4 compared with ours: its figures, its ratios to OpenCV, its claims, and their presentation as
text.

The paper's pictures are not public, so that errors in pixels are not comparable. The ratio of an error to that of
OpenCV's corners on the same pictures is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rcdn_lab.calibration.detectors import OURS
from rcdn_lab.calibration.run import ALL, COMMON
from rcdn_lab.paper.claim import Claim, folded, markdown_claims, markdown_table
from rcdn_lab.paper.table4_figures import Figures

EYE_TRACKER, WIDE_ANGLE = "eye tracker", "wide angle"
"""the paper's sets: two cameras of 720 × 1280 on a head, and a selection of whole boards from OCPAD's wide-angle
pictures"""
WITH_OCPAD = "with OCPAD"
REFERENCE = "opencv"
Row = dict[str, Any]


@dataclass(frozen=True)
class Published:
    """A row of the paper's table for one of its sets: root mean square errors, px; `whole` of 100 pictures; `on` all,
    or those that OCPAD found."""

    like: str
    method: str
    whole: int
    cal: float
    pose: float
    on: str = ALL


PUBLISHED = (
    Published(EYE_TRACKER, "Proposed", 100, 0.17721, 0.19313),
    Published(EYE_TRACKER, "OpenCV", 100, 0.18952, 0.20552),
    Published(EYE_TRACKER, "MATLAB", 100, 0.18723, 0.19420),
    Published(EYE_TRACKER, "Geiger et al.", 100, 0.19018, 0.20758),
    Published(EYE_TRACKER, "OCamCalib", 100, 0.29834, 0.33226),
    Published(EYE_TRACKER, "Proposed", 85, 0.16958, 0.18301, WITH_OCPAD),
    Published(EYE_TRACKER, "OCPAD", 85, 0.17017, 0.18559, WITH_OCPAD),
    Published(WIDE_ANGLE, "Proposed", 100, 0.21387, 0.21960),
    Published(WIDE_ANGLE, "OpenCV", 100, 0.25041, 0.24708),
    Published(WIDE_ANGLE, "MATLAB", 100, 0.22613, 0.22911),
    Published(WIDE_ANGLE, "Geiger et al.", 100, 0.25366, 0.25287),
    Published(WIDE_ANGLE, "OCamCalib", 100, 0.34511, 0.46133),
    Published(WIDE_ANGLE, "Proposed", 91, 0.22008, 0.22017, WITH_OCPAD),
    Published(WIDE_ANGLE, "OCPAD", 91, 0.22749, 0.22743, WITH_OCPAD),
)
METHODS = {
    "auto": "Proposed", "paper": "Proposed", "opencv": "OpenCV", "geiger": "Geiger et al.", "ocamcalib": "OCamCalib",
}  # fmt: skip
"""detector → the paper's name for the corresponding method whose figures are on all pictures; those of OCPAD are not"""
ELSEWHERE = frozenset({"MATLAB"})
"""programs that cannot run here, and have no detector of ours in their place"""
ERRORS = ("cal", "pose")
RATIOS = tuple(column for e in ERRORS for column in (f"{e} ÷ opencv", f"paper's {e}", f"{e} − paper's"))
"""for each error: our ratio, the paper's, the difference"""


def published_ratio(like: str, method: str, error: str) -> float | None:
    """`cal` or `pose` of a method ÷ that of OpenCV in the paper; `like` ALL: the geometric mean of its two sets. None
    if it is not in the paper."""
    if like == "ALL":
        both = [published_ratio(one, method, error) for one in (EYE_TRACKER, WIDE_ANGLE)]
        return None if None in both else float(np.sqrt(np.prod([b for b in both if b])))
    of = {p.method: getattr(p, error) for p in PUBLISHED if p.like == like and p.on == ALL}
    return of[method] / of["OpenCV"] if method in of else None


def published_rows() -> list[dict[str, Any]]:
    """The paper's table as arguments of our rows, marked as such."""
    out = []
    for p in PUBLISHED:
        note = "paper's figure, other data" + ("; can't run here" if p.method in ELSEWHERE else "")
        ratios = {f"paper's {e}": published_ratio(p.like, p.method, e) if p.on == ALL else None for e in ERRORS}
        counts = {"pictures": 100, "whole": p.whole, "views": p.whole}
        place = {"set": f"paper: {p.like}", "like": p.like, "on": p.on, "detector": p.method, "note": note}
        out.append(place | {"counts": counts, "figures": Figures(p.cal, p.pose)} | ratios)
    return out


def compared(rows: Sequence[Row]) -> list[Row]:
    """The rows with ratios to OpenCV's row on the same pictures, the paper's, and the difference; then geometric means
    over the sets."""
    reference = {(r["set"], r["on"]): r for r in rows if r["detector"] == REFERENCE}
    out = []
    for row in rows:
        other = reference.get((row["set"], row["on"]))
        ratios = {e: row[e] / other[e] if other and row[e] and other[e] else None for e in ERRORS}
        out.append(row | _beside(ratios, row["like"], row["detector"]))
    return out + _means(out)


def _beside(ratios: Mapping[str, float | None], like: str, detector: str) -> Row:
    out: Row = {}
    for error, mine in ratios.items():
        theirs = published_ratio(like, METHODS[detector], error) if mine and detector in METHODS else None
        out |= {f"{error} ÷ opencv": mine, f"paper's {error}": theirs}
        out[f"{error} − paper's"] = mine - theirs if mine and theirs else None
    return out


def _means(rows: Sequence[Row]) -> list[Row]:
    """Geometric means of the ratios over all sets in which a detector is compared on common pictures."""
    out = []
    for name in dict.fromkeys(r["detector"] for r in rows if r["on"] == COMMON):
        mine = [r for r in rows if r["on"] == COMMON and r["detector"] == name and r["cal ÷ opencv"]]
        if mine:
            ratios = {e: float(np.exp(np.mean([np.log(r[f"{e} ÷ opencv"]) for r in mine]))) for e in ERRORS}
            place = {"set": "ALL", "like": "ALL", "on": COMMON, "detector": name}
            note = f"geometric means of {len(mine)} sets"
            out.append(dict.fromkeys(rows[0]) | place | _beside(ratios, "ALL", name) | {"note": note})
    return out


# ---- claims


CLAIMS = (
    ("the lowest calibration error", "cal", False),
    ("the lowest pose error", "pose", False),
    ("the highest detection rate", "whole", False),
    ("the corners nearest to the truth", "rms", True),
    ("the cameras and poses nearest to the truth (`model`)", "model", True),
)
"""the claim, the figure that decides it, and whether it is only our requirement"""


def claims(rows: Sequence[Row], ours: Sequence[str] = ("auto", "paper")) -> list[Claim]:
    """For each set, whether ours is the best. A tie counts as the best.

    Errors are compared on the same pictures: the common ones and, for a detector excluded from these, those that it
    shares with the others.
    """
    mine = [r for r in rows if r["on"] != "-" and r["set"] != "ALL" and not r["set"].startswith("paper: ")]
    out = []
    for preset in ours:
        for name in dict.fromkeys(r["set"] for r in mine if r["detector"] == preset):
            made = (_claim(name, preset, [r for r in mine if r["set"] == name], *c) for c in CLAIMS)
            out += [c for c in made if c is not None]
    return out


def _claim(name: str, preset: str, rows: Sequence[Row], text: str, figure: str, ours: bool) -> Claim | None:
    """None for a requirement of ours if no detector has that figure."""
    pairs = _rivals(rows, preset, ALL if figure == "whole" else COMMON)
    pairs = [(a, b) for a, b in pairs if a[figure] is not None and b[figure] is not None]
    text = f"`{preset}` has {text} on {name}"
    if not pairs:
        return None if ours else Claim(text, None, "No figures.")
    sign = -1 if figure == "whole" else 1
    first = pairs[0][0]
    details = ", ".join(
        f"{b['detector']} {_value(b, figure)}{'' if a is first else f' (against {_value(a, figure)})'}"
        for a, b in pairs
    )
    return Claim(
        text, all(sign * a[figure] <= sign * b[figure] for a, b in pairs), f"{_value(first, figure)}; {details}", ours
    )


def _rivals(rows: Sequence[Row], preset: str, on: str) -> list[tuple[Row, Row]]:
    """Each rival's row once, with ours on the same pictures."""
    places = [on] + ([p for p in dict.fromkeys(r["on"] for r in rows) if p.startswith("with ")] if on == COMMON else [])
    pairs: dict[str, tuple[Row, Row]] = {}
    for place in places:
        here = {r["detector"]: r for r in rows if r["on"] == place}
        for rival, row in here.items():
            if preset in here and rival not in OURS:
                pairs.setdefault(rival, (here[preset], row))
    return list(pairs.values())


def _value(row: Row, figure: str) -> str:
    return f"{row['whole']}/{row['pictures']}" if figure == "whole" else f"{row[figure]:.4f}"


# ---- text


@dataclass(frozen=True)
class Table:
    """A table for display: `title`, names of its `columns`, `lines` of cells."""

    title: str
    columns: tuple[str, ...]
    lines: list[list[str]]

    def markdown(self) -> str:
        """As a section of a page."""
        return f"**{self.title}**\n\n{markdown_table(self.columns, self.lines)}"

    def text(self) -> str:
        """For a terminal."""
        lines = [list(self.columns), *self.lines]
        widths = [max(len(line[k]) for line in lines) for k in range(len(self.columns))]
        padded = ("  ".join(c.ljust(w) for c, w in zip(line, widths, strict=True)).rstrip() for line in lines)
        return "\n".join([self.title, *padded])


DIGITS = {"cal": 5, "pose": 5, "focal": 2, "centre": 2, "baseline": 0}
TITLE = (
    "Table 4: calibration and pose error, px, half and half; the ratio to OpenCV on the same pictures, "
    "the paper's, the difference"
)
TRUTH = (
    "Against the truth: corners (px), cameras (px), poses (degrees, share of the distance), model (px), "
    "stereo (µm, degrees)"
)


FLATTERED = (
    "The rendered boards are perfectly flat, which our refinement counts on, and come from the renderer that our "
    "networks learn from: they flatter our presets. Photographs don't."
)
MAIN = ("set", "on", "detector", "whole", "views", "corners", "outliers", "cal", "pose", *RATIOS, "note")
KNOWN = (
    "set", "on", "detector", "corners", "mean", "rms", "most", "focal", "centre", "rotation", "translation", "model",
    "pairs", "baseline", "turn",
)  # fmt: skip


def tables(rows: Sequence[Row]) -> list[Table]:
    """All rows, in one table or two."""
    known = [r for r in rows if r["mean"] is not None]
    return [_table(TITLE, MAIN, rows), *([_table(TRUTH, KNOWN, known)] if known else [])]


def _table(title: str, columns: tuple[str, ...], rows: Sequence[Row]) -> Table:
    return Table(
        title, tuple("95 %" if c == "most" else c for c in columns), [[_cell(c, r) for c in columns] for r in rows]
    )


def _cell(column: str, row: Row) -> str:
    value = row[column]
    if value is None:
        return "-"
    if column == "whole":
        return f"{value}/{row['pictures']}"
    if isinstance(value, float) and column not in ("outliers", "pairs"):
        sign = "+" if column.endswith("− paper's") else ""
        return f"{value:{sign}.{DIGITS.get(column, 3 if '÷' in column or 'paper' in column else 4)}f}"
    return str(int(value)) if isinstance(value, float) else str(value)


def markdown(rows: Sequence[Row], stated: Sequence[Claim]) -> str:
    """A section of docs/paper-results.md: the claims in short; folded, all rows and the claims' figures."""
    long = [folded(t.title.partition(":")[0], t.markdown()) for t in tables(rows)]
    parts = [_verdicts(stated), FLATTERED, *long, folded("The figures behind the claims", markdown_claims(stated))]
    return "\n\n".join(parts) + "\n"


def _verdicts(stated: Sequence[Claim]) -> str:
    """A row for each claim and a column for each set: whether the claim holds."""
    sets = list(dict.fromkeys(c.text.rpartition(" on ")[2] for c in stated))
    lines: dict[str, dict[str, str]] = {}
    for c in stated:
        text, _, one = c.text.rpartition(" on ")
        verdict = {True: "yes", False: "**no**", None: "–"}[c.holds]
        lines.setdefault(text + " (we ask)" * c.ours, {})[one] = verdict
    return markdown_table(["", *sets], [[text, *(of.get(s, "") for s in sets)] for text, of in lines.items()])
