"""`python tools/vary_constants.py MODULE:NAME... [--pictures FILE...]`: detection with a constant × 0.8 and × 1.25.

MODULE is written as in docs/constants.md (boards/graph); `config` has the settings of the preset `auto`. Whole numbers
change by one at least. The pictures are those of the hard levels of `rcdn evaluate sweep`, one a level, and the FILEs.
A line of JSON for each value, the first of the code as it is: success, recall and errors on the rendered pictures, and
of all pictures those whose boards have other labels than by the code as it is, with their boards' numbers of corners
before and after.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rcdn import Detector, DetectorConfig
from rcdn.io.images import read_image
from rcdn_lab.peers import Grid
from rcdn_lab.sweep.bound import bounds
from rcdn_lab.sweep.pictures import picture, seed_of
from rcdn_lab.sweep.score import Answers, row, score
from rcdn_lab.sweep.settings import FACTORS

SHARES = (0.8, 1.25)
HARD = {
    "noise": "40 60", "blur": "3 5", "motion": "9 15", "tilt": "60 75", "barrel": "2.5", "fisheye": "150 180",
    "contrast": "20 12", "falloff": "20", "jpeg": "10", "square": "6 8 10", "cut": "0.33 0.5", "boards": "4",
    "empty": "shapes text tiles blocks",
}  # fmt: skip
ALL = ("shadow", "cover", "two")
BENDS = ("cylinder 6", "wave 0.6")


def levels() -> list[tuple[str, str]]:
    """Factors and levels of the sweep that are hard."""
    some = [(factor, level) for factor, names in HARD.items() for level in names.split()]
    return (
        some + [("bend", level) for level in BENDS] + [(factor, level) for factor in ALL for level in FACTORS[factor]]
    )


def changed(value: Any, share: float) -> Any:
    """A number times the share; a whole one is rounded, and is another."""
    if isinstance(value, int):
        return rounded if (rounded := round(value * share)) != value else value + (1 if share > 1 else -1)
    return value * share


@contextmanager
def set_to(module: Any, name: str, value: Any) -> Iterator[None]:
    """With the constant of another value, in the module and in those that import it."""
    old = getattr(module, name)
    users = [module, *(other for other in list(sys.modules.values()) if imports(other, module.__name__, name))]
    for user in users:
        setattr(user, name, value)
    try:
        yield
    finally:
        for user in users:
            setattr(user, name, old)


def imports(user: Any, module: str, name: str) -> bool:
    """Does the module take the name from that one?"""
    path = str(getattr(user, "__file__", None))
    if not getattr(user, "__name__", "").startswith("rcdn.") or not path.endswith(".py"):
        return False
    nodes = ast.parse(Path(path).read_text("utf-8")).body
    return any(
        isinstance(n, ast.ImportFrom) and n.module == module and name in (a.name for a in n.names) for n in nodes
    )


def found(
    pictures: list[tuple[str, Any, Answers | None]], config: DetectorConfig
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Row of the rendered pictures; labels and numbers of corners of each picture's boards."""
    detector, scores, boards = Detector(config), [], {}
    for name, image, answers in pictures:
        own = detector.boards(image)
        boards[name] = [sorted(map(tuple, board.ij.tolist())) for board in own]
        if answers is not None:
            scores.append(score([Grid(b.xy, b.ij, b.sigma) for b in own], answers))
    return row(scores), boards


def main() -> None:
    """Vary each of the constants."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("constants", nargs="+", metavar="MODULE:NAME")
    parser.add_argument("--pictures", nargs="*", type=Path, default=[], metavar="FILE")
    given = parser.parse_args()
    pictures: list[tuple[str, Any, Answers | None]] = []
    for factor, level in levels():
        made = picture(FACTORS[factor][level], seed_of(factor, level, 0))
        pictures.append((f"{factor} {level}", made.image, Answers(made.boards, bounds(made.scene))))
    pictures += [(str(path), read_image(path), None) for path in given.pictures]
    baseline, boards = found(pictures, DetectorConfig.auto(threads=1))
    print(json.dumps({**baseline, "pictures": len(pictures)}), flush=True)
    for word in given.constants:
        place, name = word.split(":")
        module = importlib.import_module("rcdn." + place.replace("/", ".").removesuffix(".__init__"))
        for share in SHARES:
            if place == "config":
                value = changed(getattr(DetectorConfig.auto(), name), share)
                figures, others = found(pictures, DetectorConfig.auto(threads=1, **{name: value}))
            else:
                with set_to(module, name, value := changed(getattr(module, name), share)):
                    figures, others = found(pictures, DetectorConfig.auto(threads=1))
            differ = {
                k: [[len(b) for b in both] for both in (boards[k], others[k])] for k in boards if boards[k] != others[k]
            }
            print(json.dumps({"constant": word, "value": float(value), "differ": differ, **figures}), flush=True)


if __name__ == "__main__":
    main()
