"""Videos of different frame rates, whose frames of one number aren't of one moment."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from rcdn.terminal.group import one_line

if TYPE_CHECKING:
    from rcdn.batch.inputs import Gathered

SAME = 0.01
"""largest difference of rates that count as equal, share of the lower one: files state 29.97 and 30 of one camera"""


def rates_note(found: Iterable[Gathered]) -> str:
    """A sentence on cameras of one video each whose files state different frame rates, with the remedy; "" if they are
    equal, or other inputs than videos are used."""
    from rcdn.io.images import frame_rate

    paths = [got.images[0].path.rpartition("#")[0] if got.one_video and got.images else "" for got in found]
    if not all(paths):
        return ""
    rates = {path: frame_rate(path) for path in paths}
    low = min(rates.values())
    if max(rates.values()) <= (1 + SAME) * low:
        return ""
    (first, rate), *others = rates.items()
    stated = ", ".join(
        [f"{one_line(first)} has {rate:.4g} frames a second", *(f"{one_line(p)} {r:.4g}" for p, r in others)]
    )
    return (
        f"note: {stated}; frames of one number count as taken at one moment. Unless they were, whatever the files "
        f"state, {_remedy(rates, low)}"
    )


def _remedy(rates: dict[str, float], low: float) -> str:
    """What to do so that frames of one number are of one moment; `low`: the lowest of the `rates`."""
    fast = {path: rate / low for path, rate in rates.items() if rate > (1 + SAME) * low}
    if all(abs(ratio - round(ratio)) <= SAME * ratio for ratio in fast.values()):
        kept = " and ".join(f"one of {round(ratio)} frames of {one_line(path)}" for path, ratio in fast.items())
        return f"keep {kept}, from the first on, as a new video"
    return f"convert them to {low:.4g} frames a second, or record them again at one rate"
