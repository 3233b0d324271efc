"""Settings: frozen dataclasses, one payload type per stage, and the two presets. To and from JSON."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, get_args

from rcdn.errors import ConfigError, RcdnError, shown

if TYPE_CHECKING:
    from rcdn.types import Target

RefineMethod = Literal["peak", "saddle", "mixed", "com", "parabola", "edge"]
Recovery = Literal["graph", "growth"]
Targets = Literal["auto", "plain"]
Device = Literal["cpu", "cuda", "auto"]


def _require(ok: bool, message: str) -> None:
    if not ok:
        raise ConfigError(message)


LEVEL = 1000.0
"""largest threshold; responses do not exceed about 1"""
WIDEST, WINDOW = 999, 64
"""px: the largest box of non-maximum suppression, and the largest half window of a refinement"""
MANY = 1_000_000
"""corners or px: upper limit of every setting that counts them"""
CLUSTERS, THREADS = 1000, 1024
"""largest numbers of clusters and of threads"""


def _bounded(owner: object, name: str, low: float, high: float, whole: bool = False) -> None:
    """Raises ConfigError unless the setting is a number in [low, high]."""
    value = getattr(owner, name)
    ok = isinstance(value, int if whole else (int, float)) and not isinstance(value, bool)
    kind = "a whole number" if whole else "a finite number"
    message = f"{type(owner).__name__}.{name} must be {kind} in [{low}, {high}], not {shown(value)}"
    _require(ok and low <= value <= high, message)


def _flags(owner: object, *names: str) -> None:
    """Raises ConfigError unless the settings are true or false."""
    for name in names:
        value = getattr(owner, name)
        _require(isinstance(value, bool), f"{type(owner).__name__}.{name} must be true or false, not {shown(value)}")


def _one_of(owner: object, name: str, known: tuple[Any, ...]) -> None:
    value = getattr(owner, name)
    _require(
        isinstance(value, str) and value in known,
        f"{type(owner).__name__}.{name} must be one of {known}, not {shown(value)}",
    )


@dataclass(frozen=True)
class Adaptive:
    """Mean of the responses above `level` (paper section 3.3)."""

    level: float = 0.5

    def __post_init__(self) -> None:
        _bounded(self, "level", -LEVEL, LEVEL)


@dataclass(frozen=True)
class Fixed:
    """A constant (MATE's rule; Table 2)."""

    value: float = 0.5

    def __post_init__(self) -> None:
        _bounded(self, "value", -LEVEL, LEVEL)


@dataclass(frozen=True)
class Std:
    """Mean plus `factor` standard deviations of the whole map (paper Eq. 3)."""

    factor: float = 0.8

    def __post_init__(self) -> None:
        _bounded(self, "factor", -LEVEL, LEVEL)


@dataclass(frozen=True)
class MaxFraction:
    """`fraction` of the largest response (Table 2: 0.41 for Eq. 1, 0.57 for the squared loss)."""

    fraction: float = 0.41

    def __post_init__(self) -> None:
        _bounded(self, "fraction", 0.01, 1)


Threshold = Adaptive | Fixed | Std | MaxFraction


@dataclass(frozen=True)
class Nms:
    """Greedy non-maximum suppression with boxes of equal size.

    `box`: side, px, odd; `overlap`: intersection ÷ box area above which the weaker candidate is dropped; `peaks`: only
    pixels that none of their eight neighbours exceeds are candidates, so that the flank of a wide peak yields no
    corner.
    """

    box: int = 9
    overlap: float = 0.5
    peaks: bool = False

    def __post_init__(self) -> None:
        _bounded(self, "box", 1, WIDEST, whole=True)
        _require(self.box % 2 == 1, f"Nms.box must be odd, not {self.box}")
        _bounded(self, "overlap", 0, 1)
        _require(0 < self.overlap < 1, f"Nms.overlap must lie in (0, 1), not {self.overlap}")
        _flags(self, "peaks")


@dataclass(frozen=True)
class Cluster:
    """k-means++ on the positions (paper section 3.3).

    Clusters of at most `drop` corners are dropped. The stage is skipped for fewer than `least` corners.
    """

    k: int = 10
    drop: int = 2
    least: int = 30
    seed: int = 0

    def __post_init__(self) -> None:
        _bounded(self, "k", 1, CLUSTERS, whole=True)
        for name in ("drop", "least"):
            _bounded(self, name, 0, MANY, whole=True)
        _bounded(self, "seed", 0, 2**32 - 1, whole=True)


@dataclass(frozen=True)
class Refine:
    """Sub-pixel refinement. `half`: half window of `saddle` and `mixed`, px; None: from the local square size, with a
    second step to the centre of symmetry."""

    method: RefineMethod = "saddle"
    half: int | None = None

    def __post_init__(self) -> None:
        _one_of(self, "method", get_args(RefineMethod))
        if self.half is not None:
            _bounded(self, "half", 1, WINDOW, whole=True)


@dataclass(frozen=True)
class Sharpen:
    """A second refinement that uses the recovered board: an image model fitted to all its corners
    (docs/decisions/0007).

    `geometry`: the smoothness of the board also constrains the corners.
    """

    geometry: bool = True

    def __post_init__(self) -> None:
        _flags(self, "geometry")


@dataclass(frozen=True)
class DetectorConfig:
    """All settings of a `Detector`. The presets are `DetectorConfig.auto()` and `DetectorConfig.paper()`.

    `pattern`: squares (`checker`) or triangles (`deltille`, docs/decisions/0013-deltille.md). For deltilles, the model
    `auto` is the network trained on them, corners are refined by their antisymmetry, there is no second fit, and codes
    are not read: `refine`, `sharpen` (but None) and `target` (but `plain`) raise ConfigError unless they are defaults.
    `model`: name of weights in the package, or a path to an ONNX file with its JSON beside it.
    `rescue`: if the adaptive threshold finds nothing, the threshold becomes 0.41 of the largest response, provided that
    this response stands out from the map (over 0.15, and 20 times the 99th percentile); its corners are marked
    LOW_CONFIDENCE.
    `seed`: share of the threshold above which a peak may start a board (its corners are then accepted, whatever their
    response); `weak`: share above which a peak may complete a board that predicts it (1: no peak below the threshold
    may).
    `border`: corners closer than this to the image border are dropped, px.
    `recovery`: method of board recovery; `graph`: the validated link graph; `growth`: the paper's (docs/recovery.md).
    `target`: `auto` reads the codes of any ChArUco boards, AprilGrids and PuzzleBoards (docs/coded-boards.md); `plain`,
    as in the preset `paper`, treats all boards as plain. A `Charuco`, `AprilGrid` or `PuzzleBoard` reads that target
    alone: smaller parts of it can then be identified with certainty, since there are fewer competing hypotheses.
    `sharpen`: fit the corners of boards a second time, given their board; None: keep the refined positions.
    `pyramid`: also process reduced copies of large pictures, and enlarged copies of small or finely patterned ones.
    `threads`: threads of the network; 0 = all cores. The result doesn't depend on it.
    `device`: where the network runs: `cpu`, `cuda` (a GPU, through onnxruntime-gpu), or `auto`: the GPU if there is
    one. The corners are the same within rounding; a GPU computes the whole response, the CPU only where corners are
    possible.
    """

    model: str = "auto"
    threshold: Threshold = field(default_factory=Adaptive)
    nms: Nms = field(default_factory=lambda: Nms(box=5, peaks=True))
    cluster: Cluster | None = None
    refine: Refine = field(default_factory=Refine)
    sharpen: Sharpen | None = field(default_factory=Sharpen)
    border: float = 3.0
    rescue: bool = True
    seed: float = 0.45
    weak: float = 0.12
    recovery: Recovery = "graph"
    pyramid: bool = True
    min_corners: int = 9
    threads: int = 0
    pattern: Literal["checker", "deltille"] = "checker"
    target: Targets | Target = "auto"
    device: Device = "cpu"

    def __post_init__(self) -> None:
        kinds = (
            ("model", str),
            ("threshold", Threshold),
            ("nms", Nms),
            ("cluster", Cluster | None),
            ("refine", Refine),
            ("sharpen", Sharpen | None),
        )
        for name, kind in kinds:
            value = getattr(self, name)
            _require(isinstance(value, kind), f"DetectorConfig.{name} can't be {shown(value)}")
        _one_of(self, "recovery", get_args(Recovery))
        _one_of(self, "pattern", ("checker", "deltille"))
        _check_target(self.target)
        self._check_pattern()
        _one_of(self, "device", get_args(Device))
        _flags(self, "pyramid", "rescue")
        _bounded(self, "border", 0, MANY)
        _bounded(self, "seed", 0.01, 1)
        _bounded(self, "weak", 0.01, 1)
        _bounded(self, "min_corners", 1, MANY, whole=True)
        _bounded(self, "threads", 0, THREADS, whole=True)

    def _check_pattern(self) -> None:
        """Raises ConfigError for settings that boards of triangles can't use."""
        if self.pattern == "checker":
            return
        _require(
            self.recovery == "graph",
            "DetectorConfig.recovery 'growth' (the preset 'paper') knows squares only; "
            "for a deltille take the preset 'auto'",
        )
        usable = {
            "refine": self.refine == Refine(), "sharpen": self.sharpen in (None, Sharpen()),
            "target": self.target in ("auto", "plain"),
        }  # fmt: skip
        for name, fits in usable.items():
            _require(fits, f"DetectorConfig.{name} has no meaning for a deltille; leave it out")

    def __repr__(self) -> str:
        """The closer preset with the settings that differ from it: a Python expression for an equal value."""
        fields = [f.name for f in dataclasses.fields(self)]
        presets = {name: DetectorConfig.preset(name) for name in ("auto", "paper")}
        differs = {k: [n for n in fields if getattr(self, n) != getattr(v, n)] for k, v in presets.items()}
        name = min(presets, key=lambda k: len(differs[k]))
        return f"DetectorConfig.{name}({', '.join(f'{n}={getattr(self, n)!r}' for n in differs[name])})"

    @property
    def weights(self) -> str:
        """Name or path of the weights that `model` stands for: `auto` uses a separate network for deltilles."""
        return "rcdn_deltille" if self.pattern == "deltille" and self.model == "auto" else self.model

    @classmethod
    def auto(cls, **changes: Any) -> DetectorConfig:
        """The most accurate settings of rcdn (the default)."""
        return cls(**changes)

    @classmethod
    def paper(cls, **changes: Any) -> DetectorConfig:
        """The settings stated in the paper: model F, adaptive threshold, 9×9 NMS, k-means++, mixed refinement."""
        base: dict[str, Any] = {
            "model": "paper", "threshold": Adaptive(), "nms": Nms(), "cluster": Cluster(),
            "refine": Refine("mixed", half=2), "sharpen": None, "border": 7.0, "rescue": False, "seed": 1.0,
            "weak": 1.0, "recovery": "growth", "pyramid": False, "target": "plain",
        }  # fmt: skip
        return cls(**(base | changes))

    @classmethod
    def preset(cls, name: str, **changes: Any) -> DetectorConfig:
        """The preset called `name` (`auto` or `paper`)."""
        _require(name in ("auto", "paper"), f"preset must be 'auto' or 'paper', not {shown(name)}")
        return cls.auto(**changes) if name == "auto" else cls.paper(**changes)

    def to_json(self) -> str:
        """JSON text that `from_json` reads back to an equal value."""
        return json.dumps(_to_plain(self))

    @classmethod
    def from_json(cls, text: str) -> DetectorConfig:
        """Read what `to_json` wrote. Unknown keys, bad values and anything that isn't JSON raise ConfigError."""
        try:
            plain = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise ConfigError(f"config: this is not JSON: {shown(str(error))}") from error
        value = _from_plain(plain)
        _require(isinstance(value, cls), f"expected a DetectorConfig, not {type(value).__name__}")
        return value


def _check_target(value: Any) -> None:
    """Raises ConfigError unless `value` is a valid setting `target`."""
    if isinstance(value, str) and value in get_args(Targets):
        return
    from rcdn.types.target import Target  # imported here: it needs NumPy, settings don't

    _require(
        isinstance(value, Target),
        f"DetectorConfig.target must be one of {get_args(Targets)}, or a Charuco, AprilGrid or PuzzleBoard, "
        f"not {shown(value)}",
    )


_PAYLOADS = {c.__name__: c for c in (*get_args(Threshold), Nms, Cluster, Refine, Sharpen, DetectorConfig)}


def _to_plain(value: Any) -> Any:
    if hasattr(value, "kind"):  # a target, which has its own representation in all files
        from rcdn.types.target import target_record

        return target_record(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: _to_plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
        return {"type": type(value).__name__, **fields}
    return value


def _from_plain(value: Any) -> Any:
    if not isinstance(value, dict):
        return value
    if "kind" in value:
        from rcdn.types.target import target_of

        try:
            return target_of(value)
        except RcdnError as error:
            raise ConfigError(f"config: {error}") from error
    name = value.get("type")
    _require(
        isinstance(name, str) and name in _PAYLOADS, f"config: unknown type {shown(name)}; known: {sorted(_PAYLOADS)}"
    )
    cls = _PAYLOADS[str(name)]
    known = {f.name for f in dataclasses.fields(cls)}
    unknown = sorted(set(value) - known - {"type"})
    _require(not unknown, f"config: {name} has no setting {shown(unknown)}; known: {sorted(known)}")
    return cls(**{k: _from_plain(v) for k, v in value.items() if k != "type"})
