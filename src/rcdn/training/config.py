"""Settings of a training run, read from TOML."""

from __future__ import annotations

import dataclasses
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rcdn.errors import ConfigError, FormatError, shown
from rcdn.io.fields import read_text
from rcdn.training.loss import BALANCED, LOSSES
from rcdn.training.net import ARCHITECTURES
from rcdn.training.samples import PoolConfig

LONGEST = 120
"""largest number of characters of a run's name"""


@dataclass(frozen=True)
class TrainConfig:
    """One training run.

    `name`: of the run's folder; `architecture`: a name in `net.ARCHITECTURES`; `batch_norm`: train with batch
    normalisation (folded into the convolutions on export);
    `loss`: a name in `loss.LOSSES`; `normalisation`: minmax | local;
    `optimiser`: sgd (momentum 0.9, the learning rate decays exponentially to 1 % over `steps`; paper section 3.2) or
    adamw (one-cycle); `decay`: λ of Eq. 1 (sgd: on all parameters) or AdamW's weight decay;
    `clip`: largest gradient norm, 0 = none; `side`: side of a training window, px, context included;
    `ring`: the 8 neighbours of a corner are excluded from the loss;
    `start`: weights as initial values, or '': `last.pt` of another run, or an exported network (.onnx), which trains
    without batch normalisation;
    `teacher`: name of a run in the same folder to whose network one 1×1 layer is added (A → B, E → F; paper section
    3.1), or ''; the teacher's layers are frozen for the first `frozen` steps;
    `mined`: every so many steps the averaged network looks at all crops, and from then on every second window is drawn
    by how much it answers where there is no corner; 0: never;
    `background`: how many times the background's mean counts in the loss (Eq. 1: once);
    `labelled`: a file of labelled pictures, or its folder (`labelled.read_labelled`), or ''; crops of them are the
    share `labelled_share` of the training data.
    """

    name: str
    architecture: str = "F"
    loss: str = "safe"
    normalisation: str = "minmax"
    optimiser: str = "sgd"
    rate: float = 0.01
    decay: float = 1e-4
    clip: float = 5.0
    batch: int = 20
    side: int = 80
    steps: int = 20_000
    ring: bool = True
    ema: float = 0.999
    seed: int = 1
    validate_every: int = 1000
    start: str = ""
    teacher: str = ""
    frozen: int = 0
    batch_norm: bool = False
    mined: int = 0
    background: float = 1.0
    labelled: str = ""
    labelled_share: float = 0.25
    pool: PoolConfig = field(default_factory=PoolConfig)

    def __post_init__(self) -> None:
        for key, name in (("name", self.name), ("teacher", self.teacher or "none")):
            if (
                name in ("", ".", "..")
                or not name.isprintable()
                or any(c in name for c in "/\\:")
                or len(name) > LONGEST
            ):
                raise ConfigError(
                    f"config: {key} must be the bare name of a folder in the runs' folder, "
                    f"without / and \\, not {name!r}"
                )
        for key, known in _CHOICES.items():
            if getattr(self, key) not in known:
                raise ConfigError(f"config: {key} must be one of {sorted(known)}, not {shown(getattr(self, key))}")
        for key, (least, most) in _RANGES.items():
            if not least <= getattr(self, key) <= most:
                raise ConfigError(f"config: {key} must be in [{least}, {most}], not {shown(getattr(self, key))}")
        if self.background != 1 and self.loss not in BALANCED:
            raise ConfigError(f"config: background: the loss {self.loss!r} has no weight of the background; leave it 1")
        if not self.rate > 0 or not self.ema < 1:
            raise ConfigError(f"config: rate must be above 0 and ema below 1, not {self.rate} and {self.ema}")
        if not 0 < self.labelled_share < 1:
            raise ConfigError(f"config: labelled_share must be between 0 and 1, not {self.labelled_share}")
        if self.batch_norm and Path(self.start).suffix == ".onnx":
            raise ConfigError("config: an exported network as `start` has no `batch_norm`; remove that line")
        if self.teacher and (self.start or self.batch_norm):
            raise ConfigError("config: a network with a teacher has neither `start` nor `batch_norm`")
        arch = ARCHITECTURES[self.architecture]
        context = sum(arch.margins)
        if not context < self.side <= self.pool.size or (self.side - context) % arch.cell:
            raise ConfigError(
                f"config: side must be {context} plus a multiple of {arch.cell} for architecture "
                f"{self.architecture}, and at most pool.size = {self.pool.size}; not {self.side}"
            )


_CHOICES: dict[str, Any] = {
    "architecture": ARCHITECTURES, "loss": LOSSES, "normalisation": ("minmax", "local"), "optimiser": ("sgd", "adamw"),
}  # fmt: skip
_RANGES = {
    "batch": (1, 100_000), "side": (1, 10_000), "steps": (1, 10**9), "validate_every": (1, 10**9),
    "seed": (0, 2**32 - 1), "rate": (0, 100), "decay": (0, 100), "clip": (0, 1e6), "ema": (0, 1), "frozen": (0, 10**9),
    "mined": (0, 10**9), "background": (1e-3, 1e3),
}  # fmt: skip


def read_config(path: Path) -> TrainConfig:
    """Settings from a TOML file. Raises ConfigError naming an unknown key, a bad value or a bad file.

    `recipe = "FILE"` names a file, relative to this one, with the settings that this file doesn't state, so that
    several networks can share one recipe; a recipe may name another one.
    """
    values = _with_recipes(path, ())
    values.setdefault("name", path.stem)
    pool = values.get("pool", {})
    if not isinstance(pool, dict):
        raise ConfigError(f"config: pool must be a table, [pool], not {shown(pool)}")
    values["pool"] = _checked(PoolConfig, pool, "pool.")
    return _checked(TrainConfig, values, "")


def _with_recipes(path: Path, named_by: tuple[Path, ...]) -> dict[str, Any]:
    """The settings of a file and of its recipes; `named_by`: the files whose recipe it is."""
    if path.resolve() in named_by:
        raise ConfigError(f"config: {path} is a recipe of its own recipe; leave one of the lines `recipe` out")
    values = _read(path)
    if (recipe := values.pop("recipe", None)) is None:
        return values
    if not isinstance(recipe, str):
        raise ConfigError(f"config: recipe must be the name of a file, not {shown(recipe)}")
    return _with_recipes(path.parent / recipe, (*named_by, path.resolve())) | values


def _read(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(read_text(path))
    except FormatError as error:
        raise ConfigError(f"config: {error}") from error
    except (ValueError, RecursionError) as error:  # from TOML syntax, or from its numbers and dates
        raise ConfigError(f"config: {path} is not TOML: {shown(str(error))}") from error


LARGEST_INTEGER = 2**63
"""limit of TOML's integers; Python's parser also accepts larger ones"""


def _checked(cls: Any, values: dict[str, Any], prefix: str) -> Any:
    types = {f.name: type(f.default) for f in dataclasses.fields(cls) if f.default is not dataclasses.MISSING}
    types["name"] = str  # the one setting without a default
    known = {f.name for f in dataclasses.fields(cls)}
    for key, value in values.items():
        if key not in known:
            raise ConfigError(f"config: unknown key {shown(prefix + key)}; known: {sorted(known)}")
        wanted = types.get(key)
        if wanted is float and isinstance(value, int) and not isinstance(value, bool) and abs(value) < LARGEST_INTEGER:
            values[key] = float(value)
        elif wanted in (int, str, bool, float) and type(value) is not wanted:
            raise ConfigError(f"config: {prefix + key} must be of type {wanted.__name__}, not {shown(value)}")
    return cls(**values)
