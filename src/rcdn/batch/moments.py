"""Grouping the pictures of several cameras that were taken at the same moment: by name, else by number, else by
order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rcdn.batch.pairs import stems, trailing_numbers
from rcdn.errors import ConfigError

if TYPE_CHECKING:
    from rcdn.batch.inputs import Numbers


def cameras_in(inputs: Sequence[str]) -> dict[str, list[str]]:
    """The inputs by camera name: one folder with a subfolder or video for each camera, or one input for each camera.
    Raises ConfigError if there is only one camera."""
    from rcdn.io import is_video

    if len(inputs) == 1 and Path(inputs[0]).is_dir():
        inside = sorted(Path(inputs[0]).iterdir())
        inputs = [str(p) for p in inside if p.is_dir() and not p.name.startswith(".")]
        inputs = inputs or [str(p) for p in inside if is_video(p)]
    if len(inputs) < 2:
        raise ConfigError(
            "--rig takes two inputs or more, one a camera, or one folder that holds a folder or a video of each"
        )
    names = [_name(i) for i in inputs]
    if max(Counter(names).values()) > 1:
        names = [f"cam{k}" for k in range(len(inputs))]
    return {name: [i] for name, i in zip(names, inputs, strict=True)}


def _name(text: str) -> str:
    """The name of a folder, of a file without its ending, or of a pattern without its wildcards."""
    path = Path(text)
    name = path.name if path.is_dir() else path.stem
    return name.replace("*", "").replace("?", "").strip("_-. ") or path.parent.name or text


def chosen_by_any(frames: Sequence[Numbers]) -> Numbers:
    """The union of the frame numbers chosen in the cameras' videos, so that all cameras have the same; () if they have
    different numbers of videos."""
    if len({len(each) for each in frames}) > 1:
        return ()
    return tuple(tuple(sorted(set().union(*numbers))) for numbers in zip(*frames, strict=True))


def moments_of(pictures: Sequence[Sequence[str]]) -> tuple[list[list[str]], str]:
    """For each camera the moments of its pictures, and the rule that determined them: name, number or order.

    By the file names, else by the last number in them, provided that most moments are then shared by several cameras;
    else by order, if all cameras have equally many pictures. Raises ConfigError if none of these rules applies.
    """
    ways: list[tuple[str, Callable[[Sequence[str]], list[str]]]] = [("name", stems), ("number", trailing_numbers)]
    for way, keys_of in ways:
        keys = [keys_of(names) for names in pictures]
        if all(k and all(k) and len(set(k)) == len(k) for k in keys) and _shared(keys):
            return keys, way
    if len({len(names) for names in pictures}) == 1:
        return [[str(k) for k in range(len(names))] for names in pictures], "order"
    counts = ", ".join(str(len(names)) for names in pictures)
    raise ConfigError(
        f"the cameras' pictures ({counts}) don't belong together by name (a/01.png and b/01.png) or by number "
        "(a_01.png and b_01.png); give names that do, or as many of each in the same order"
    )


def _shared(keys: Sequence[Sequence[str]]) -> bool:
    """Whether every camera shares a moment with another one, and most moments are shared."""
    count = Counter(key for each in keys for key in each)
    alone = sum(1 for key in count if count[key] == 1)
    return all(any(count[key] > 1 for key in each) for each in keys) and 2 * alone < len(count)
