"""`rcdn render`: synthetic pictures of checkerboards with exact ground truth."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from enum import StrEnum
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rcdn.errors import ConfigError, RcdnError, many
from rcdn.terminal.options import GridSize, parse_folder, two_numbers

if TYPE_CHECKING:
    from rcdn.synthetic import BoardTruth, Scene


class Difficulty(StrEnum):
    """Ranges of parameters from which scenes are drawn."""

    ordinary = "ordinary"
    hard = "hard"


def parse_frame(text: str) -> GridSize:
    """`640x480` (also `640X480`, `640×480`) as width and height, px, each in 64..10000. Raises typer.BadParameter."""
    size = two_numbers(text, 5)
    if size is None:
        raise typer.BadParameter(f"{text!r} is not a size; give width x height in pixels, such as 640x480")
    if min(size) < 64 or max(size) > 10_000:
        raise typer.BadParameter(f"{text!r}: width and height must lie between 64 and 10000 px")
    return size


def render(
    output: Annotated[
        Path,
        typer.Argument(parser=parse_folder, metavar="OUT_DIR", help="The folder to write to; it is made if need be."),
    ],
    count: Annotated[int, typer.Option(min=1, max=999_999, metavar="N", help="How many pictures.")] = 10,
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="The same seed gives the same pictures.")] = 1,
    ranges: Annotated[
        Difficulty, typer.Option(help="ordinary: calibration pictures as people take them. hard: much worse.")
    ] = Difficulty.ordinary,
    size: Annotated[
        GridSize, typer.Option(parser=parse_frame, metavar="WIDTHxHEIGHT", help="Size of the pictures, px.")
    ] = "640x480",  # type: ignore[assignment]  # Typer parses defaults, too
    one_camera: Annotated[
        bool,
        typer.Option("--one-camera", help="One board before one camera, to calibrate it; --ranges doesn't count then."),
    ] = False,
    scene: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.json", help="Render this one scene again, from its .json; the options above don't count."
        ),
    ] = None,
) -> None:
    """Render random pictures of checkerboards, with everything known about them.

    Each scene_000001.png has a .json beside it: all that the scene is made of, and the exact corners of its boards.
    truth.json holds the corners of all pictures, to score what `rcdn detect OUT_DIR --json FILE` finds.
    """
    from rcdn.io import write_image, write_text
    from rcdn.synthetic import render as paint
    from rcdn.synthetic import truth

    scenes: Iterator[Scene] = (
        iter([_read_scene(scene)]) if scene else _random(count, seed, None if one_camera else ranges, size)
    )
    images: dict[str, Any] = {}
    sizes = set()
    for number, item in enumerate(_tracked(scenes, 1 if scene else count), start=1):
        name = f"scene_{number:06d}"
        boards = truth(item)
        write_image(output / f"{name}.png", paint(item))
        write_text(output / f"{name}.json", _scene_json(item, boards))
        images[f"{name}.png"] = _image_truth(boards)
        sizes |= {(b.cols, b.rows) for b in item.boards}
    board = list(sizes.pop()) if len(sizes) == 1 else None
    if board is None:  # labels are scored against a single board size
        images = {name: values | {"ordered": False} for name, values in images.items()}
    # one image per line
    lines = ",\n".join(f"{_dump(name)}: {_dump(values)}" for name, values in images.items())
    head = f'{_dump(output.resolve().name)}: {{"board": {_dump(board)}, "exhaustive": true, "images": {{'
    write_text(output / "truth.json", f"{{{head}\n{lines}\n}}}}}}\n")
    corners = sum(len(values["xy"] or ()) for values in images.values())
    typer.echo(f"wrote {many(len(images), 'picture')} with {many(corners, 'corner')} to {output}, and truth.json")


def _random(count: int, seed: int, ranges: Difficulty | None, size: GridSize) -> Iterator[Scene]:
    """`count` random scenes; scene k depends on `seed` and k only. Without `ranges` all have the same board and
    camera."""
    import numpy as np

    from rcdn.synthetic import PRESETS, camera_view, random_scene

    for number in range(1, count + 1):
        if ranges is None:
            yield camera_view(seed, number, size)
            continue
        yield random_scene(np.random.default_rng((seed, number)), PRESETS[ranges.value], size)


def _read_scene(path: Path) -> Scene:
    import json

    from rcdn.io.fields import read_json, read_text
    from rcdn.synthetic import scene_from_json

    try:
        values = read_json(path, read_text(path), "give the .json of a picture that `rcdn render` wrote")
        return scene_from_json(json.dumps(values.get("scene", values) if isinstance(values, dict) else values))
    except RcdnError as error:
        raise ConfigError(f"--scene {error}" if str(path) in str(error) else f"--scene {path}: {error}") from error


def _tracked(scenes: Iterator[Scene], total: int) -> Iterator[Scene]:
    """`scenes`, with a progress bar on stderr if that is a terminal."""
    from rich.console import Console
    from rich.progress import track

    quiet = not sys.stderr.isatty()
    yield from track(scenes, "rendering", total, console=Console(stderr=True), transient=True, disable=quiet)


def _scene_json(scene: Scene, boards: list[BoardTruth]) -> str:
    import json

    truths = [
        {
            "ij": b.ij.tolist(),
            "xy": [point if all(map(isfinite, point)) else None for point in b.xy.tolist()],  # None: not seen
            "visible": b.visible.tolist(),
            "ignore": b.ignore.tolist(),
        }
        for b in boards
    ]
    return _dump({"version": 1, "scene": json.loads(scene.to_json()), "boards": truths}) + "\n"


def _image_truth(boards: list[BoardTruth]) -> dict[str, Any]:
    """Ground truth of a picture: corners to be detected, and positions at which detections aren't scored; `xy` is None
    if there are only such positions."""
    xy = [point for b in boards for point in b.xy[b.visible].tolist()]
    ignore = [point for b in boards for point in b.xy[b.ignore].tolist()]
    ordered = len(boards) == 1 and bool(boards[0].visible.all())
    return {"xy": None if ignore and not xy else xy, "ordered": ordered, "ignore": ignore}


def _dump(value: Any) -> str:
    import json

    return json.dumps(value, allow_nan=False)
