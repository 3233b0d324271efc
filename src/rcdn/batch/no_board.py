"""Why no board, or not the board that was asked for, was found in any of many pictures, as far as it can be told."""

from __future__ import annotations

from collections.abc import Iterable
from fnmatch import fnmatchcase
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from rcdn.errors import RcdnError, many
from rcdn.terminal import console

if TYPE_CHECKING:
    from rcdn.batch.inputs import Gathered
    from rcdn.types import Target

OTHER_LAYOUT = (
    "{} of {} are {}, not {}: correct the target's legacy, since of boards that are cut the layout may not be seen"
)
EXAMINED = 3
"""The largest number of pictures that are searched for single markers."""


def markers_hint(names: Iterable[str]) -> str | None:
    """A sentence on markers that stand alone in the first of the pictures called `names`, or None.

    A name that is no picture (a frame of a video) is skipped, and so is a picture that can't be read any more.
    """
    from rcdn.io import is_video
    from rcdn.io.images import grey_of
    from rcdn.targets.single_markers import single_markers

    for name in islice((n for n in names if Path(n).is_file() and not is_video(n)), EXAMINED):
        try:
            found = single_markers(grey_of(name))
        except RcdnError:
            continue
        if found is not None:
            dictionary, ids = found
            return (
                f"not supported: single markers ({name} shows {many(len(ids), 'marker')} of {dictionary}); "
                "a board needs corners where squares meet: `rcdn board --pattern aprilgrid` or `charuco` prints one"
            )
    return None


def target_hint(wanted: str | Target, found: Iterable[str]) -> str | None:
    """A sentence if a target is `wanted`, not just `auto` or `plain`, and none of the boards `found` was read as such:
    the targets of all boards as text, "" for those without codes."""
    texts = list(found)
    kind = str(wanted)
    if isinstance(wanted, str) or not texts:
        return None
    if same := [text for text in texts if may_be(text, kind)]:
        other = [text for text in same if _legacy(text) != _legacy(kind) and "?" not in text]
        return OTHER_LAYOUT.format(len(other), many(len(texts), "board"), other[0], kind) if other else None
    others = ", ".join(sorted({text for text in texts if text}))
    seen = f"they are {others}" if others else "`--target auto` tells what they are, if they carry codes"
    return f"of {many(len(texts), 'board')} none carries the codes of {kind}; {seen}"


def _legacy(text: str) -> bool:
    return "legacy" in text.split()


def may_be(text: str, kind: str) -> bool:
    """Whether a board read as `text` may be of the target `kind`: a part of a board has unknown sides, `8x?`. Which
    layout a ChArUco board has doesn't count."""
    read, wanted = ([word for word in t.split() if word != "legacy"] for t in (text, kind))
    same = (fnmatchcase(word, part.replace("?", "*")) for part, word in zip(read, wanted, strict=False))
    return len(read) == len(wanted) and all(same)


def note_target(wanted: str | Target, got: Gathered) -> None:
    """Print the `target_hint` of the boards of many pictures, if there is one."""
    if hint := target_hint(wanted, (str(board.target or "") for image in got.images for board in image.boards)):
        console.note(f"hint: {hint}")
