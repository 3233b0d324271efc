"""Files of saved detections: telling them from other files, and a folder with one for each camera of a rig."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path


def holds_detections(path: Path) -> bool:
    """Whether a file contains detections, judged by its ending (.vnl) or its first lines; False if it can't be read."""
    if path.suffix.lower() == ".vnl":
        return True
    try:
        with open(path, encoding="utf-8", errors="replace") as file:
            head = file.read(2000).lstrip("\ufeff \n")
    except OSError:
        return False
    return head.startswith("# filename") or re.match(r'\{[^{\[]*"images"\s*:', head) is not None


def saved_in_folder(inputs: Sequence[str]) -> list[str]:
    """The files of saved detections in the only input, a folder in which there are neither folders nor videos; else
    the `inputs` themselves."""
    from rcdn.io import is_video
    from rcdn.io.finding import natural

    if len(inputs) != 1 or not Path(inputs[0]).is_dir():
        return [*inputs]
    inside = [p for p in Path(inputs[0]).iterdir() if not p.name.startswith(".")]
    if any(p.is_dir() or is_video(p) for p in inside):
        return [*inputs]
    saved = [str(p) for p in inside if p.suffix.lower() in (".json", ".vnl") and p.is_file() and holds_detections(p)]
    return sorted(saved, key=natural) or [*inputs]
