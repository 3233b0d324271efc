"""Claims of the paper, or requirements of ours, about a figure, and whether our results confirm them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Claim:
    """`text`: the claim; `holds`: whether our figures confirm it, None if they cannot decide; `found`: those figures,
    in words.

    `ours`: a requirement of ours, not a claim of the paper.
    """

    text: str
    holds: bool | None
    found: str
    ours: bool = False

    @property
    def verdict(self) -> str:
        return {True: "holds", False: "doesn't hold", None: "not checked"}[self.holds]


def lines(claims: Iterable[Claim]) -> list[str]:
    """Lines for a terminal: the paper's claims first, then ours."""
    listed = sorted(claims, key=lambda claim: claim.ours)
    return [f"{claim.verdict:>12}: {'(we ask) ' if claim.ours else ''}{claim.text}. {claim.found}" for claim in listed]


def markdown_table(header: Iterable[str], body: Iterable[Iterable[str]]) -> str:
    """A Markdown table; the first column is text, the others are figures."""
    head = list(header)
    rule = ["---", *["---:"] * (len(head) - 1)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, rule, *body))


def folded(title: str, *parts: str) -> str:
    """Markdown with a collapsed section."""
    return "\n\n".join([f"<details>\n<summary>{title}</summary>", *parts, "</details>"])


def markdown_claims(claims: Iterable[Claim]) -> str:
    """Markdown: claim, verdict, figures; a table of the paper's claims, and one of ours if there are any."""
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
