"""All parts of the suite, which can also be run separately."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rcdn.errors import ConfigError
from rcdn_lab.coded import real, rendered, videos, without
from rcdn_lab.peers.coded import CODED_PEERS

PARTS = (real.PART, real.DEGRADED, videos.PART, rendered.PART, without.PART)
Step = Callable[[int, int], None] | None


@dataclass(frozen=True)
class Plan:
    """The measurements to make. `data`: the folder with `truth.json` and the videos; `without`: folders of pictures
    without codes, except the sets in `skip`; `count`: pictures for each kind and condition; `kinds`, `conditions` of
    the rendered part, empty: all; `scenes` rendered without codes; `peers`: names of other readers; `pictures`: folder
    in which rendered ones are kept."""

    data: Path | None = None
    without: tuple[Path, ...] = ()
    skip: tuple[str, ...] = ()
    count: int = 5
    kinds: tuple[str, ...] = ()
    conditions: tuple[str, ...] = ()
    scenes: int = 1000
    peers: tuple[str, ...] = ()
    workers: int = 1
    pictures: Path | None = None


def parts_of(parts: Sequence[str], plan: Plan) -> list[str]:
    """The requested parts, in their order; by default all that are possible, those with photographs only if the data
    folder is given. Raises ConfigError."""
    if unknown := [part for part in parts if part not in PARTS]:
        raise ConfigError(f"--part: nothing is called {', '.join(unknown)}; known: {', '.join(PARTS)}")
    need_data = (real.PART, real.DEGRADED, videos.PART)
    if plan.data is None and (lost := [part for part in parts if part in need_data]):
        raise ConfigError(f"--part {lost[0]} needs DATA, the folder with truth.json and the videos")
    return [part for part in PARTS if part in parts or (not parts and (plan.data is not None or part not in need_data))]


def settings_of(plan: Plan, parts: Sequence[str]) -> dict[str, Any]:
    """Settings recorded with the figures."""
    return {
        "parts": list(parts), "skip": list(plan.skip), "scenes": plan.scenes,
        "rendered": rendered.settings_of(plan.count),
        "peers": {name: CODED_PEERS[name].version() for name in plan.peers},
    }  # fmt: skip


def table(part: str, plan: Plan, step: Step = None) -> list[dict[str, Any]]:
    """The rows of one part; every row has `part` and `set`."""
    if part == rendered.PART:
        return rendered.table(plan.count, plan.kinds, plan.conditions, plan.peers, plan.workers, step, plan.pictures)
    if part == without.PART:
        return without.table(plan.without, plan.skip, plan.scenes, plan.workers, step)
    data = plan.data
    if data is None:
        raise ConfigError(f"{part} needs a folder with truth.json and the videos")
    if part == videos.PART:
        return videos.table(data, plan.peers, plan.workers, step)
    conditions = (real.AS_IT_IS,) if part == real.PART else real.CONDITIONS
    return real.table(data, plan.peers, conditions, plan.workers, step)


def shown(part: str, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The rows of a part in a form that fits a terminal: for rendered boards one row for each kind and reader."""
    if part == rendered.PART:
        return rendered.by_kind(rows)
    return [{k: v for k, v in r.items() if k not in ("of", "failed")} for r in rows]
