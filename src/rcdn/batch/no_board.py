"""Why no board was found in any of many pictures, as far as it can be told."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice
from pathlib import Path

from rcdn.errors import RcdnError, many

EXAMINED = 3
"""The largest number of pictures that are searched for single markers."""


def markers_hint(names: Iterable[str]) -> str | None:
    """A sentence on markers that stand alone in the first of the pictures called `names`, or None.

    A name that is no picture (a frame of a video) is skipped, and so is a picture that can't be read any more.
    """
    from rcdn.io import is_video, read_image
    from rcdn.io.images import grey_of
    from rcdn.targets.single_markers import single_markers

    for name in islice((n for n in names if Path(n).is_file() and not is_video(n)), EXAMINED):
        try:
            found = single_markers(grey_of(read_image(name)))
        except RcdnError:
            continue
        if found is not None:
            dictionary, ids = found
            return (
                f"not supported: single markers ({name} shows {many(len(ids), 'marker')} of {dictionary}); "
                "a board needs corners where squares meet: `rcdn board --pattern aprilgrid` or `charuco` prints one"
            )
    return None
