"""The verdict on the page: the banner, the reasons, and the limits of the checks."""

from __future__ import annotations

from collections.abc import Sequence

from rcdn.calibration.limits import Limit, growth
from rcdn.calibration.verdict import MEANING, WORD, sentences
from rcdn.report.calibration.markup import Html, each, number, percent, pixels, tag
from rcdn.types import LEVELS, Reason, Verdict

SIGNS = {
    "good": '<circle cx="12" cy="12" r="10.5"/><path d="M6.8 12.6l3.6 3.6 7-7.8"/>',
    "fair": '<path d="M12 2.6L22.6 21.2H1.4z"/><path d="M12 9.4v5.4M12 17.6v.4"/>',
    "unsure": '<path d="M12 1.4L22.6 12L12 22.6L1.4 12z"/><path d="M9.3 9.6c0-3.6 5.6-3.4 5.4-.2-.1 2-2.7 2.1-2.7 4.4M12 17v.4"/>',
    "bad": '<path d="M7.8 1.6h8.4l6.2 6.2v8.4l-6.2 6.2H7.8l-6.2-6.2V7.8z"/><path d="M8 8l8 8M16 8l-8 8"/>',
}
"""A tick in a circle, an exclamation mark in a triangle, a question mark in a diamond, a cross in an octagon:
distinguishable without colours."""


def sign(level: str) -> Html:
    """The symbol of a level."""
    strokes = 'fill="none" stroke="currentColor" stroke-width="2" stroke-linecap="round" stroke-linejoin="round"'
    return Html(f'<svg class="sign" viewBox="0 0 24 24" aria-hidden="true"><g {strokes}>{SIGNS[level]}</g></svg>')


def banner(found: Verdict, summary: str) -> Html:
    """The verdict in a word, its meaning with the most serious reason, and a sentence on the measurements."""
    said = " ".join(filter(None, [MEANING[found.level].capitalize(), *sentences(found)[:1]]))
    words = tag("div", tag("h2", WORD[found.level], id="verdict"), tag("p", said))
    return tag(
        "section", tag("div", sign(found.level), words, class_="top"), tag("p", summary, class_="summary"),
        class_=f"card verdict {found.level}", aria_labelledby="verdict",
    )  # fmt: skip


def reasons(found: Verdict, advice: Sequence[str], limits: Sequence[Limit], hint: str = "") -> Html:
    """The reasons, the most serious first, one per line with its symbol, then other notes."""
    rows = []
    for r in found.reasons:
        said = tag("span", f" ({r.level})", class_="sr")
        head = tag("div", tag("span", r.what, said), tag("span", value_of(r)), class_="head")
        rows.append(tag("li", sign(r.level), tag("div", head, tag("p", f"{r.sentence} {r.action}")), class_=r.level))
    card = tag("div", tag("ul", each(rows), class_="reasons"), _thresholds(limits, hint), class_="card")
    notes = [line for line in advice if line not in sentences(found)]
    if not notes:
        return card
    steps = tag("ol", each([tag("li", line) for line in notes]), class_="advice")
    return each([card, tag("div", tag("h3", "What else to know"), steps, class_="card")])


def value_of(reason: Reason) -> str:
    """A reason's value in its unit."""
    if reason.unit == "px":
        return pixels(reason.value)
    if reason.unit == "share":
        return percent(reason.value)
    if not reason.unit:  # a count
        return f"{reason.value:g}"
    return f"{number(reason.value)}{'' if reason.unit == '°' else ' '}{reason.unit}"


def limits_hint(image_size: tuple[int, int]) -> str:
    """A note on limits that are scaled with the picture's size."""
    factor = growth(image_size)
    return "" if factor == 1 else f" In a picture as large as this, limits in px are {factor:.2g} times these."


def _thresholds(limits: Sequence[Limit], hint: str) -> Html:
    rows = [
        tag(
            "tr",
            tag("th", limit.what, tag("div", limit.why, class_="soft why-limit"), scope="row"),
            *(tag("td", limit.words(level), class_="n") for level in LEVELS),
        )
        for limit in limits
    ]
    heads = (tag("th", w, scope="col", class_="n" if w in LEVELS else None) for w in ("Check", *LEVELS))
    table = tag(
        "table",
        tag("caption", "The verdict is the worst of these checks." + hint),
        tag("thead", tag("tr", *heads)),
        tag("tbody", each(rows)),
    )
    return tag("details", tag("summary", "Where the lines are drawn"), tag("div", table, class_="wide"))
