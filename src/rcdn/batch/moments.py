"""Grouping the pictures of several cameras that were taken at the same moment: by name, else by number, else by
time stamps that differ, else by order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rcdn.batch.pairs import a_few_tell, distinct_keys, stems, trailing_numbers
from rcdn.batch.time_stamps import FEWEST, by_time
from rcdn.errors import ConfigError, many

if TYPE_CHECKING:
    from rcdn.batch.inputs import Numbers


def cameras_in(inputs: Sequence[str]) -> dict[str, list[str]]:
    """The inputs by camera name: one folder with a subfolder or video for each camera, or one input for each camera
    (of one folder with a file of saved detections for each, `saved_in_folder` gives these files). Raises ConfigError if
    there is only one camera."""
    from rcdn.io import is_video

    if len(inputs) == 1 and Path(inputs[0]).is_dir():
        inside = sorted(Path(inputs[0]).iterdir())
        inputs = [str(p) for p in inside if p.is_dir() and not p.name.startswith(".")]
        inputs = inputs or [str(p) for p in inside if is_video(p)]
    if len(inputs) < 2:
        raise ConfigError(
            "--rig takes two inputs or more, one a camera, or one folder that holds a folder, a video or a file of "
            "saved detections of each"
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


def moments_of(pictures: Sequence[Sequence[str]], way_out: str = "") -> tuple[list[list[str]], str]:
    """For each camera the moments of its pictures, and the rule that determined them: name, number, order, or time with
    how far the stamps of one moment are apart.

    By the file names, else by the last number in them, provided that most moments are then shared by several cameras.
    Else, or if that joins more pictures and all that belong together by these, by time stamps in the names that differ
    by little (`by_time`). Else by name or number if every camera then shares FEWEST moments or more with others that
    `a_few_tell`, since cameras may have pictures of their own; else by order, if all cameras have equally many
    pictures. Raises ConfigError if none of these rules applies; `way_out`: what else than other names helps.
    """
    ways: list[tuple[str, Callable[[Sequence[str]], list[str]]]] = [("name", stems), ("number", trailing_numbers)]
    found = [(way, [keys_of(names) for names in pictures]) for way, keys_of in ways]
    found = [(way, keys) for way, keys in found if all(map(distinct_keys, keys))]
    most = next(((keys, way) for way, keys in found if _each_shares(keys, 1) and _most_shared(keys)), None)
    timed = by_time([stems(names) for names in pictures])
    if timed is not None and (most is None or _joins_more(timed.keys, most[0])):
        return timed.keys, f"time, at most {timed.apart} apart"
    if most is not None:
        return most
    for way, keys in found:
        if _each_shares(keys, FEWEST) and a_few_tell(way, keys, pictures):
            return keys, way
    if len({len(names) for names in pictures}) == 1:
        return [[str(k) for k in range(len(names))] for names in pictures], "order"
    counts = ", ".join(str(len(names)) for names in pictures)
    way_out = f", or {way_out}" if way_out else ""
    raise ConfigError(
        f"the cameras' pictures ({counts}) don't belong together by name (a/01.png and b/01.png) or by number "
        f"(a_01.png and b_01.png); give names that do, or as many of each in the same order{way_out}"
    )


def moments_note(keys: Sequence[Sequence[str]], way: str, way_out: str = "") -> str:
    """A sentence on the rule of `moments_of` that was used, and on the `way_out`; "" if names leave no doubt."""
    if way == "order":
        return (
            "note: pictures belong together by order, since names and numbers don't say which do. If that is wrong, "
            f"{way_out or 'give pictures of one moment one name (a/01.png and b/01.png)'}"
        )
    if way == "name" and _most_shared(keys):
        return ""
    shared, alone = _shared_and_alone(keys)
    way_out = f". If that is wrong, {way_out}" if way_out else ""
    return (
        f"note: pictures belong together by {way}: {many(shared, 'moment')} of several cameras, "
        f"{alone} of one camera only{way_out}"
    )


def _joins_more(these: Sequence[Sequence[str]], others: Sequence[Sequence[str]]) -> bool:
    """Whether pictures that belong together by the `others` do so by `these`, and more pictures do."""
    joined = dict[str, set[str]]()
    for camera, of_camera in zip(these, others, strict=True):
        for this, other in zip(camera, of_camera, strict=True):
            joined.setdefault(other, set()).add(this)
    return all(len(each) == 1 for each in joined.values()) and len(set().union(*joined.values())) < len(joined)


def _each_shares(keys: Sequence[Sequence[str]], fewest: int) -> bool:
    """Whether every camera shares so many moments or more with other ones."""
    count = Counter(key for each in keys for key in each)
    return all(sum(count[key] > 1 for key in each) >= fewest for each in keys)


def _most_shared(keys: Sequence[Sequence[str]]) -> bool:
    """Whether most moments are shared by several cameras."""
    shared, alone = _shared_and_alone(keys)
    return alone < shared


def _shared_and_alone(keys: Sequence[Sequence[str]]) -> tuple[int, int]:
    """How many moments several cameras share, and how many only one has."""
    count = Counter(key for each in keys for key in each)
    shared = sum(n > 1 for n in count.values())
    return shared, len(count) - shared
