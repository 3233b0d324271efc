"""Tables 2 and 3 as text: for the terminal, and as sections of the documentation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rcdn_lab.paper.claim import folded
from rcdn_lab.paper.table_claims import LEVEL, Comparison, claims, claims_of_seeds, measured, published

TITLES = {
    "table2": "Table 2: thresholds and losses", "table3": "Table 3: networks", "seeds": "Table 3 from two seeds",
}  # fmt: skip
SHORT = {
    "precision": "precision", "recall": "recall", "strict precision": "strict P", "strict recall": "strict R",
    "paper precision": "paper P", "paper recall": "paper R", "precision difference": "diff P",
    "recall difference": "diff R",
}  # fmt: skip
BY_SEED = (
    "All networks by one budget, each from two seeds; F is the one of that budget, not the preset's. The claims on the "
    f"means of both seeds: a difference counts if it is significant at {LEVEL:.0%} by Student's t, with the scatter of "
    "all networks' seeds on the same set. One comparison in twenty is significant by chance. Seeds are those of the "
    "initial weights and of the windows drawn; the crops are the same."
)
READING = (
    "A detection is true if a true corner is closer than 4 px (the paper's reading; a second detection of one corner "
    "is true as well), `strict`: one to one. All detections of a set together. No refinement."
)


def printed(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The columns that fit a terminal."""
    return [
        {k: r[k] for k in ("network", "threshold", "set", "pictures")}
        | {short: r[k] for k, short in SHORT.items()}
        | {"note": r["note"][:7]}
        for r in rows
    ]


def by_seed(rows: Sequence[Mapping[str, Any]]) -> str:
    """A table: a line a network, a column a set, precision / recall."""
    sets = list(dict.fromkeys(r["set"] for r in rows if r["precision"] is not None))
    lines = ["| network | " + " | ".join(sets) + " |", "|---|" + "---|" * len(sets)]
    for network in dict.fromkeys(r["network"] for r in rows if r["network"] != "-"):
        mine = {r["set"]: r for r in rows if r["network"] == network}
        shown = [f"{mine[s]['precision']:.4f} / {mine[s]['recall']:.4f}" if s in mine else "–" for s in sets]
        lines.append(f"| {network} | " + " | ".join(shown) + " |")
    return "\n".join(lines)


def verdicts(table: str, rows: Sequence[Mapping[str, Any]]) -> list[tuple[Comparison, Comparison]]:
    """Each claim of section 4.1 on the paper's own figures, and on ours."""
    if table == "seeds":
        own = {claim.text: claim for claim in claims("table3", published("table3"))}
        return [(own[claim.text], claim) for claim in claims_of_seeds(rows)]
    return list(zip(claims(table, published(table)), claims(table, measured(rows)), strict=True))


def claim_lines(table: str, rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """The claims as lines."""
    out = []
    for paper, ours in verdicts(table, rows):
        found = _told(ours) if table == "seeds" else ours.verdict
        out += [f"{ours.text}: {found} (in the paper's own table: {paper.verdict})"]
        out += [f"    {ours.details}"] if ours.details else []
    return out


def markdown(
    table: str, rows: Sequence[Mapping[str, Any]], facts: Mapping[str, Any], settings: Mapping[str, Any], command: str
) -> str:
    """A section of the documentation: a picture, the claims and, folded, all rows and the claims' figures. `facts`: as
    returned by `provenance`."""
    made = (
        f"`{command}` at commit {facts['commit']}, {facts['date']}, {facts['platform']}, {facts['cpus']} CPUs; "
        f"rendered pictures from seed {settings['first seed']}."
    )
    clusters = "with clustering (but for ChESS)" if settings["cluster"] else "without clustering"
    read = f"{READING} Post-processing of the preset `paper`, {clusters}."
    if table == "seeds":
        every = folded("Precision and recall of each", by_seed(rows))
        parts = [f"### {TITLES[table]}", BY_SEED, _significant(rows), _skipped(rows), every, made]
        return "\n\n".join(part for part in parts if part)
    parts = [f"## {TITLES[table]}", picture(table), _claims(table, rows), _skipped(rows)]
    parts += [folded("All rows, and how they were made", made, read, _grain(rows), _table(rows))]
    parts += [folded("The figures behind the claims", _figures(table, rows))]
    return "\n\n".join(part for part in parts if part) + "\n"


def picture(table: str) -> str:
    """The picture of a table drawn by `docs/images/draw_paper.py`."""
    return f"![{TITLES[table]}, ours beside the paper's](images/paper/{table}.svg)"


def _grain(rows: Sequence[Mapping[str, Any]]) -> str:
    corners = {r["set"]: r["corners"] for r in rows if r["corners"]}
    if not corners:
        return ""
    return "One corner is " + ", ".join(f"{1 / n:.5f} of {name}" for name, n in corners.items()) + "."


def _table(rows: Sequence[Mapping[str, Any]]) -> str:
    head = ("network", "threshold", "set", "pictures")
    figures = (
        "paper precision", "precision", "precision difference", "paper recall", "recall", "recall difference",
        "strict precision", "strict recall",
    )  # fmt: skip
    named = [
        f.replace("precision difference", "difference").replace("recall difference", "difference") for f in figures
    ]
    lines = ["| " + " | ".join([*head, *named]) + " |", "|" + "---|" * 4 + "---:|" * len(figures)]
    for r in rows:
        cells = [str(r[k]) for k in head] + [_cell(f, r[f]) for f in figures]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _cell(name: str, value: float | None) -> str:
    if value is None:
        return "–"
    return f"{value:+.4f}".replace("-", "−") if "difference" in name else f"{value:.4f}"


def _skipped(rows: Sequence[Mapping[str, Any]]) -> str:
    return "\n".join(f"- {name_of(r)}: {r['note']}" for r in rows if r["note"])


def name_of(row: Mapping[str, Any]) -> str:
    """The network or set of a row without figures."""
    return str(row["set"] if row["network"] == "-" else row["network"])


def _claims(table: str, rows: Sequence[Mapping[str, Any]]) -> str:
    lines = ["| section 4.1 says | its own table | here |", "|---|---|---|"]
    lines += [
        f"| {paper.text} | {paper.verdict} | {_stressed(ours.verdict)} |" for paper, ours in verdicts(table, rows)
    ]
    return "\n".join(lines)


def _told(claim: Comparison) -> str:
    yes, no, unknown = (list(claim.signs.values()).count(sign) for sign in (1, -1, 0))
    return f"holds on {yes} of {yes + no + unknown}, doesn't on {no}, can't be told on {unknown}"


def _significant(rows: Sequence[Mapping[str, Any]]) -> str:
    lines = ["| section 4.1 says | its own table | holds | doesn't hold | can't be told |", "|---|---|---|---|---|"]
    for paper, ours in verdicts("seeds", rows):
        yes, no, open_ = (", ".join(case for case, s in ours.signs.items() if s == k) or "–" for k in (1, -1, 0))
        lines.append(f"| {ours.text} | {paper.verdict} | {yes} | {no} | {open_} |")
    return "\n".join(lines)


def _stressed(verdict: str) -> str:
    return f"**{verdict}**" if verdict.startswith("doesn't") else verdict


def _figures(table: str, rows: Sequence[Mapping[str, Any]]) -> str:
    lines = ["| section 4.1 says | figures here |", "|---|---|"]
    lines += [f"| {ours.text} | {ours.details or '–'} |" for _, ours in verdicts(table, rows)]
    return "\n".join(lines)
