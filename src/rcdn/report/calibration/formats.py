"""Numbers and names as text for readers."""

from __future__ import annotations

import numpy as np

DASH = "–"
"""placeholder for an unknown number"""


def coordinate(value: float, decimals: int = 1) -> str:
    """A number for a drawing in its shortest form: 12.0 is 12, −0.0 is 0."""
    text = f"{float(value):.{decimals}f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return "0" if text in ("-0", "") else text


def number(value: float, digits: int = 3, sign: bool = False) -> str:
    """A number with about `digits` digits, without an exponent between 0.001 and a million; a dash if it isn't
    finite."""
    value = float(value)
    if not np.isfinite(value):
        return DASH
    if value != 0 and not 1e-3 <= abs(value) < 1e6:
        text = f"{value:.{digits - 1}e}"
    else:
        whole = int(np.floor(np.log10(abs(value)))) if value else 0
        text = f"{value:.{max(digits - 1 - whole, 0)}f}"
    return ("+" if sign and value > 0 else "") + text.replace("-", "−")


def pixels(value: float) -> str:
    """A length in pixels: three decimals from 0.1 to 1, else three digits."""
    if np.isfinite(value) and 0.1 <= abs(value) < 1:
        return f"{value:.3f} px".replace("-", "−")
    return f"{number(value)} px" if np.isfinite(value) else DASH


def bare_pixels(value: float) -> str:
    """As `pixels`, without the unit: for a column that states it."""
    return pixels(value).removesuffix(" px")


def percent(share: float) -> str:
    """A fraction as a percentage, with two digits below ten."""
    share = 100 * float(share)
    return f"{number(share, 2) if not abs(share) >= 10 else round(share)} %"


def value_and_std(value: float, std: float) -> tuple[str, str]:
    """A value and its standard deviation: two digits of the deviation, and the value to the same decimal place."""
    if not np.isfinite(std) or std <= 0:
        return f"{value:.6g}".replace("-", "−"), DASH
    decimals = int(np.clip(1 - np.floor(np.log10(std)), 0, 12))
    return f"{value:.{decimals}f}".replace("-", "−"), f"{std:.{decimals}f}"


def thousands(many: int) -> str:
    """A count with its thousands apart: `1,234`."""
    return f"{many:,}"


def counted(many: int, one: str, more: str = "") -> str:
    """A count with its noun: `1 board`, `2 boards`, `1,234 corners`."""
    return f"{many:,} {one if many == 1 else more or one + 's'}"


def short(name: str) -> str:
    """The name of a file without its folder."""
    return name.replace("\\", "/").rstrip("/").rsplit("/", 1)[-1] or name
