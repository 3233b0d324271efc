"""The thresholds of the verdict, each with its reason.

They follow the practice of people who calibrate cameras, and were checked on public sets of photographs and on
simulated faults; they are not strict bounds.
"""

from __future__ import annotations

from dataclasses import dataclass

from rcdn.types import LEVELS, Level, Reason

REFERENCE = 1600.0
"""px; thresholds in pixels grow in proportion for pictures whose longer side is longer"""
NEVER = float("inf")


@dataclass(frozen=True)
class Limit:
    """A value is good up to `good`, fair up to `fair`, unsure up to `unsure` and bad beyond (`rising`: at least these
    values are required instead). `what` is measured, in `unit` (`share`: a fraction of 1); `why`, the reason for the
    thresholds; `grows`: whether they grow with large pictures."""

    what: str
    unit: str
    good: float
    fair: float
    unsure: float
    why: str
    rising: bool = False
    grows: bool = False

    @property
    def bounds(self) -> tuple[float, float, float]:
        """The last values that are good, fair and unsure."""
        return self.good, self.fair, self.unsure

    def level(self, value: float, factor: float = 1.0) -> Level:
        """The level of `value`, with the thresholds multiplied by `factor`. NaN is unsure: a value that cannot be
        measured cannot be judged."""
        if value != value:
            return "unsure"
        for level, bound in zip(LEVELS, self.bounds, strict=False):
            if value >= bound * factor if self.rising else value <= bound * factor:
                return level
        return "bad"

    def bound(self, level: Level) -> float:
        """The threshold that a value of `level` meets if it is good, otherwise the one that it fails."""
        return self.bounds[max(LEVELS.index(level) - 1, 0)]

    def words(self, level: Level) -> str:
        """`≤ 0.5 px`, as printed in the report; "" for a level that no value can have."""
        k = LEVELS.index(level)
        last = self.bounds[min(k, 2)]
        end = 0.0 if self.rising else NEVER  # no value lies beyond it
        if k and (self.bounds[k - 1] == end or (k < 3 and last == self.bounds[k - 1])):
            return ""
        if k < 3 and last == end:
            k, last = 3, self.bounds[k - 1]
        unit = "%" if self.unit == "share" else self.unit
        sign, edge = ("≥", "<") if self.rising else ("≤", ">")
        return f"{edge if k == 3 else sign} {last * (100 if self.unit == 'share' else 1):g} {unit}".rstrip()


def growth(image_size: tuple[int, int]) -> float:
    """The factor of thresholds in pixels."""
    return max(1.0, max(image_size) / REFERENCE)


LIMITS = {
    "one_camera": Limit(
        "Difference of the cameras of groups of pictures (RMS after the best rotation)", "px", 0.0, 0.0, NEVER,
        "Groups by name, order or focal length that differ by more than views of one camera do, or pictures turned by "
        "180°; one set of numbers can't be right for both.",
    ),
    "spacing": Limit(
        "Side of a square", "m", 0.5, 0.5, NEVER,
        "A board of half-metre squares is 5 m wide; a number that large is millimetres or centimetres.",
    ),
    "picture_size": Limit(
        "Pictures of another size", "share", 0.0, 0.1, NEVER,
        "They are left out; a few may be a slip, more are another camera or another setting.",
    ),
    "board_size": Limit(
        "Views that show the same smaller board instead of the named one", "share", 0.0, 0.5, NEVER,
        "A board named by its squares is never seen whole: every view shows one corner less each way. "
        "Parts of a large board differ from view to view.",
    ),
    "views": Limit(
        "Different boards used", "", 10, 5, 0,
        "Ten views let chance average out; below five one bad picture bends the whole result. "
        "Near-duplicates count once.", rising=True,
    ),
    "tilt": Limit(
        "Tilt of the boards", "°", 20, 10, 0,
        "A board parallel to the sensor doesn't tell focal length from distance.", rising=True,
    ),
    "tilt_spread": Limit(
        "Spread of the tilts, in the direction of the least", "°", 4, 2, 0,
        "Tilts about one axis, or all alike, leave focal length and principal point to make up for each other.",
        rising=True,
    ),
    "unsettled": Limit(
        "Scatter between views ÷ what still counts as known", "×", 1.0, 1.0, 1.0,
        "Focal length to 5 %, principal point to 5 % of the diagonal, fx ÷ fy to 3 %: "
        "what views don't agree on any better isn't known.",
    ),
    "stretched": Limit(
        "Squares wider than high", "share", 0.005, 0.015, NEVER,
        "Printers stretch by a few thousandths; the shape of the board is solved for, "
        "but lengths in poses may be off by it.",
    ),
    "bent": Limit(
        "Bend of the board, share of its side", "share", 0.005, 0.02, NEVER,
        "Paper on cardboard stands out by 1 mm in 300, which is solved for; "
        "a strongly bent board bends anew in every picture, too.",
    ),
    "left_out": Limit(
        "Views left out", "share", 0.1, 0.15, 0.5,
        "Where more than every seventh view disagrees with the others, something was different in them.",
    ),
    "dropped": Limit(
        "Corners left out of the views used", "share", 0.05, 0.15, 0.3,
        "A good detector is wrong in a few per cent; beyond that the model is at fault, "
        "and what is left only looks well.",
    ),
    "crowded": Limit(
        "Largest share of corners left out in one region", "share", 0.2, 0.4, NEVER,
        "Wrong corners lie scattered; a region that is left out is one where the lens model or the board is wrong.",
    ),
    "rms": Limit(
        "Reprojection error (RMS)", "px", 0.5, 1.0, 2.0,
        "Corners of a sharp picture are found to 0.1 px; the rest is board, print, lens and motion.", grows=True,
    ),
    "held_out": Limit(
        "RMS in held-out pictures ÷ RMS", "×", 1.25, 1.75, 3.0,
        "What predicts new pictures much worse than its own has fitted its own noise.",
    ),
    "systematic": Limit(
        "Systematic part of the residuals over the sensor (RMS)", "px", 0.1, 0.25, 1.0,
        "Means over cells that chance doesn't explain: directions there are wrong by as much, "
        "and no deviation holds it.", grows=True,
    ),
    "smooth": Limit(
        "Part of the residuals that neighbours share (RMS)", "px", 0.35, 0.45, 2.0,
        "Noise of corners is independent; what neighbours share is a bent board, "
        "a moving picture or a lens that isn't followed.", grows=True,
    ),
    "uneven": Limit(
        "RMS of the rougher half of the views ÷ the other half", "×", 2.5, 4.0, NEVER,
        "Views of one camera and one board scatter alike: within 1.8 times in all good sets tried.",
    ),
    "reach": Limit(
        "Frame that the lens model covers", "share", 0.995, 0.97, 0.8,
        "Where the model folds back a pixel has no ray.", rising=True,
    ),
    "coverage": Limit(
        "Sensor covered by corners", "share", 0.6, 0.4, 0.1,
        "Where no corner was, the lens is extrapolated.", rising=True,
    ),
    "focal": Limit(
        "Standard deviation of the focal length", "share", 0.005, 0.03, 0.1,
        "All distances measured with the camera are off by the same share.",
    ),
    "centre": Limit(
        "Standard deviation of the principal point, share of the width", "share", 0.005, 0.03, 0.1,
        "All directions are turned by as much, unless poses make up for it.",
    ),
    "aspect": Limit(
        "fy ÷ fx beyond 1 by more than three standard deviations", "share", 0.015, 0.025, NEVER,
        "Pixels of today's sensors are square to a thousandth; a stretched print or video isn't.",
    ),
    "typical": Limit(
        "Projection uncertainty, median over the picture", "px", 1.0, 4.0, 20.0,
        "The size of error to expect in half of the picture.", grows=True,
    ),
    "corners": Limit(
        "Projection uncertainty in the picture’s corners", "px", 10.0, NEVER, NEVER,
        "Few boards reach the corners; it matters to those who use them.", grows=True,
    ),
}  # fmt: skip
"""the thresholds of one camera's verdict"""
STEREO_LIMITS = {
    "pairs": Limit("Pairs used", "", 10, 5, 0, "As for views.", rising=True),
    "pair_rms": Limit(
        "Reprojection error of both cameras (RMS)", "px", 0.5, 1.0, 2.0, "As for one camera.", grows=True,
    ),
    "epipolar": Limit(
        "Distance from epipolar lines (RMS)", "px", 0.5, 1.0, 2.0,
        "Stereo matchers look along these lines, to half a pixel.", grows=True,
    ),
    "baseline": Limit(
        "Standard deviation of the baseline", "share", 0.0025, 0.01, 0.05,
        "All depths are off by the same share.",
    ),
}  # fmt: skip
"""additional thresholds for a pair of cameras"""
RIG_LIMITS = {
    "components": Limit(
        "Parts of the rig that no board connects", "", 1, 1, 1, "Nothing tells where one part stands to the other."
    ),
    "thin": Limit(
        "Cameras that hang on one board", "", 0, 0, NEVER,
        "A single wrong view would move the camera, and nothing would tell.",
    ),
    "fixed_boards": Limit(
        "Parts of the boards that keep no place to each other", "", 1, NEVER, NEVER,
        "Boards that are fixed to each other agree on it in every moment; "
        "what can't be placed is solved for as a board of its own.",
    ),
    "rig_rms": Limit("Reprojection error of all cameras (RMS)", "px", 0.5, 1.0, 2.0, "As for one camera.", grows=True),
    "time_shift": Limit(
        "Cameras that are out of step", "", 0, 0, NEVER,
        "A board that moves is then at different places for different cameras."
    ),
}  # fmt: skip
"""additional thresholds for a rig of many cameras"""


def reason(
    key: str, value: float, good: str, wrong: str, action: str, *, factor: float = 1.0, level: Level | None = None
) -> Reason:
    """The reason that the check `key` gives for `value`: the sentence `good` if the value is good, otherwise `wrong`
    and `action`.

    `factor`: of thresholds in pixels. `level`: overrides the level by the thresholds, where the value alone does not
    determine it.
    """
    limit = (LIMITS | STEREO_LIMITS | RIG_LIMITS)[key]
    factor = factor if limit.grows else 1.0
    found = level or limit.level(value, factor)
    fine = found == "good"
    bound = limit.bound(found) * factor
    return Reason(
        key, found, limit.what, float(value), bound, limit.unit, good if fine else wrong, "" if fine else action
    )
