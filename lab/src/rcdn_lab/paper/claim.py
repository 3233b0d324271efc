"""What the paper says of a figure, or we ask of it, and whether our rows say so."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Claim:
    """`text`: what is claimed; `holds`: whether our figures agree, None if they can't tell; `found`: those figures, in words.

    `ours`: the paper doesn't say it, we ask.
    """

    text: str
    holds: bool | None
    found: str
    ours: bool = False

    @property
    def verdict(self) -> str:
        return {True: "holds", False: "doesn't hold", None: "not checked"}[self.holds]


def lines(claims: Iterable[Claim]) -> list[str]:
    """For a terminal: the paper's first, then ours."""
    listed = sorted(claims, key=lambda claim: claim.ours)
    return [f"{claim.verdict:>12}: {'(we ask) ' if claim.ours else ''}{claim.text}. {claim.found}" for claim in listed]


def markdown_table(header: Iterable[str], body: Iterable[Iterable[str]]) -> str:
    """Markdown; the first column is text, the others are figures."""
    head = list(header)
    rule = ["---", *["---:"] * (len(head) - 1)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, rule, *body))


def folded(title: str, *parts: str) -> str:
    """Markdown that is shown only to those who open it."""
    return "\n\n".join([f"<details>\n<summary>{title}</summary>", *parts, "</details>"])


def markdown_claims(claims: Iterable[Claim]) -> str:
    """Markdown: claim, verdict, figures; a table of the paper's, and one of ours if there are any."""
    every = list(claims)
    tables = []
    for title, mine in (("the paper says", [c for c in every if not c.ours]), ("we ask", [c for c in every if c.ours])):
        body = [
            f"| {c.text} | {'**' * (c.holds is False)}{c.verdict}{'**' * (c.holds is False)} | {c.found} |"
            for c in mine
        ]
        if body:
            tables.append("\n".join([f"| {title} | here | figures |", "|---|---|---|", *body]))
    return "\n\n".join(tables)
