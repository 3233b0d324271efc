"""Result files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rcdn.io import write_text
from rcdn.provenance import provenance


def save(path: Path, suite: str, settings: dict[str, Any], rows: list[dict[str, Any]]) -> None:
    """Write one result file: suite, settings, provenance and figures. Whole or not at all."""
    record = {"suite": suite, "provenance": provenance(), "settings": settings, "rows": rows}
    write_text(path, json.dumps(record, indent=1) + "\n")
