"""Tables on a terminal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rcdn.terminal.group import one_line


def columns(rows: Sequence[dict[str, Any]]) -> list[str]:
    """A table in columns: text to the left, numbers to the right."""
    if not rows:
        return ["(nothing)"]
    cells = {c: [_cell(row[c]) for row in rows] for c in rows[0]}
    is_text = {c: any(isinstance(row[c], str) for row in rows) for c in cells}
    put: dict[bool, Callable[[str, int], str]] = {True: str.ljust, False: str.rjust}
    widths = {c: max(map(len, (c, *cells[c]))) for c in cells}
    texts = [list(cells), *[list(line) for line in zip(*cells.values(), strict=True)]]
    return [
        "  ".join(put[is_text[c]](t, widths[c]) for c, t in zip(cells, line, strict=True)).rstrip() for line in texts
    ]


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1000 else f"{value:.0f}"
    return one_line(str(value))
