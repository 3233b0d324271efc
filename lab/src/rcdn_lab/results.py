"""Results as files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rcdn.io import write_text
from rcdn.provenance import provenance


def save(path: Path, suite: str, settings: dict[str, Any], rows: list[dict[str, Any]]) -> None:
    """One result file: what was measured, with which settings, where, and the figures. Whole or not at all."""
    record = {"suite": suite, "provenance": provenance(), "settings": settings, "rows": rows}
    write_text(path, json.dumps(record, indent=1) + "\n")
