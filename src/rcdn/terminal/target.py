"""`--target`: the boards to detect, an option of every verb that detects boards."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from rcdn.errors import ConfigError, RcdnError, present
from rcdn.terminal.options import GridSize, PatternName
from rcdn.terminal.spacing import Length, Lengths, length_of_file

if TYPE_CHECKING:
    from rcdn.types import Print, PuzzleBoard
    from rcdn.types import Target as Coded

MEASURED = 0.05
"""largest relative difference between a measured print and the spacing stated in its file"""


@dataclass(frozen=True)
class TargetOption:
    """The value of --target: the codes to read (`DetectorConfig.target`); for a plain board its `size` in inner corners
    and whether it is a `deltille`; for a file its `spacing`, m. `text` is the user's input."""

    text: str
    reads: Literal["auto", "plain"] | Coded
    size: GridSize | None = None
    deltille: bool = False
    spacing: float | None = None

    def __str__(self) -> str:
        return self.text  # shown as the default in the help

    def pattern(self, given: PatternName) -> PatternName:
        """The boards' pattern by --pattern and --target. Raises ConfigError if they contradict each other."""
        if given is PatternName.deltille and not self.deltille and self.text not in ("auto", "plain"):
            raise ConfigError(
                f"--pattern deltille and --target {self.text} contradict each other; leave one of them out"
            )
        return PatternName.deltille if self.deltille else given

    def board(self, given: GridSize | None) -> GridSize | None:
        """The board's inner corners by --board or --target. Raises ConfigError if they differ."""
        if given is None or self.size is None or given == self.size:
            return given or self.size
        raise ConfigError(
            f"--board {given.cols}x{given.rows} and --target {self.text} contradict each other; leave one of them out"
        )

    def length(self, given: Length | Lengths | None) -> Length | Lengths:
        """The spacing by --spacing, or by the target's file. Raises ConfigError if neither states it, or if they differ
        too much."""
        if given is None and self.spacing is None:
            raise ConfigError(
                "--spacing is missing: the side of one square or tag, such as 25mm; or a --target FILE that says it"
            )
        if isinstance(given, Lengths):
            return given
        if given is not None:
            if self.spacing is not None and not abs(given - self.spacing) <= MEASURED * self.spacing:
                raise ConfigError(
                    f"--spacing {given.text} is {float(given):g} m, but {self.text} says {self.spacing:g} m; leave "
                    "--spacing out, or mend the file"
                )
            return given
        return length_of_file(self.text, present(self.spacing, "--spacing"))


DEFAULT = TargetOption("auto", "auto")
"""the option wasn't given: the preset's setting applies"""


def parse_target(text: str | TargetOption) -> TargetOption:
    """Parse `text`: `auto`, `plain`, a target in one word, or the path of its YAML file. Raises typer.BadParameter."""
    if isinstance(text, TargetOption):  # a default
        return text
    word = text.strip()
    if word == "auto" or word == "plain":
        return TargetOption(word, "auto" if word == "auto" else "plain")
    from rcdn.targets.specification import read_specification
    from rcdn.types import Printed

    try:
        parsed = read_specification(word)
    except RcdnError as error:
        raise typer.BadParameter(str(error)) from error
    target, spacing = (parsed.target, parsed.spacing) if isinstance(parsed, Printed) else (parsed, None)
    return _option(word, target, spacing)


def _option(text: str, target: Print | PuzzleBoard, spacing: float | None) -> TargetOption:
    from rcdn.types import Checkerboard, Deltille, PuzzlePart

    if isinstance(target, Deltille):
        return TargetOption(text, "plain", deltille=True, spacing=spacing)
    if isinstance(target, Checkerboard):
        return TargetOption(text, "plain", GridSize(target.columns, target.rows), spacing=spacing)
    return TargetOption(text, target.whole if isinstance(target, PuzzlePart) else target, spacing=spacing)


Target = Annotated[
    TargetOption,
    typer.Option(
        parser=parse_target,
        metavar="WHICH",
        help="auto: read the codes of ChArUco boards, AprilGrids and PuzzleBoards, if there are any; nobody has to say "
        "which. plain: take all boards for plain ones. One target alone, of which smaller parts are certain: "
        "charuco:8x8:DICT_4X4_50:0.75, aprilgrid:6x6:tag36h11:0.3, puzzleboard, checkerboard:9x6, or the YAML file of "
        "one, which `rcdn board --yaml` or Kalibr's users write.",
    ),
]
