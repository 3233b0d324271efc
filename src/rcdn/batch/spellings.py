"""Names of files whose accents are spelled in two ways: as one character, or as a letter and a mark, as they come from
some systems. Names are compared in the first one (NFC)."""

from __future__ import annotations

import os
from unicodedata import normalize


def composed(name: str) -> str:
    """The name with each accented letter as one character, so that both spellings are equal."""
    return normalize("NFC", name)


def composed_path(path: str | os.PathLike[str]) -> str:
    """The absolute path, spelled likewise."""
    return composed(os.path.abspath(path))
