"""Draw docs/images/live*.png: the page of `rcdn live` in Chromium, before a rendered camera.

In the repository's root: python docs/images/draw_live.py
"""

from __future__ import annotations

import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import cv2

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.live.browser import begin, open_browser, until, views  # noqa: E402
from tests.live.following import Hand, served  # noqa: E402
from tests.live.two_cameras import Hands  # noqa: E402

HINT = "return ['hint', 'sentence'].map((name) => document.getElementById(name).textContent)"
COLOURS = 96
"""that a picture keeps, so that its file stays small"""
PAGES = (
    ("live", (1280, 860), False, 3, 800),
    ("live-phone", (390, 844), True, 3, 390),
    ("wide", (1920, 1080), True, 4, 1920),
)
TWO = (
    ("live-stereo", (1280, 1110), False, 5, 900),
    ("stereo-phone", (390, 1400), True, 3, 390),
    ("stereo-wide", (1920, 1080), True, 3, 1920),
)
"""the page of one camera and of two: name, size of the window, dark, pictures taken before it is drawn, and px that the
drawing is wide; those whose names don't begin with `live` are only looked at"""


def main(others: Path | None = None) -> None:
    """Draw the pages of the docs, and into a folder `others` the rest, with the first page and the last."""
    every = [(p, Hand, 1) for p in PAGES] + [(p, partial(Hands, moves=30), 2) for p in TWO]
    for (name, size, dark, count, width), hand, cameras in every:
        if not others and not name.startswith("live"):
            continue
        place = Path(__file__).parent if name.startswith("live") else others or Path()
        with (
            tempfile.TemporaryDirectory() as folder,
            served(Path(folder) / "my-camera", hand(noise=1.0), cameras) as address,
        ):
            browser = open_browser("none.mjpeg", size, dark)
            try:
                if others:
                    browser.get(address)
                    time.sleep(0.8)
                    browser.save_screenshot(str(others / f"{name}-begin.png"))
                begin(browser, address, "")
                until(browser, lambda b, n=count: views(b) >= n, 600)
                until(browser, _shows_a_way, 300)
                drawn = str(others / f"{name}-whole.png") if others else f"{folder}/x.png"
                browser.save_screenshot(drawn)
                write(place / f"{name}.png", cv2.imread(drawn), width)
                if others and name == "wide":
                    until(browser, lambda b: b.find_element("id", "verdict").is_displayed(), 300)
                    browser.save_screenshot(str(others / "end.png"))
            finally:
                browser.quit()


def _shows_a_way(browser: object) -> bool:
    """Whether the board is seen, elsewhere than it is wanted."""
    hint, sentence = browser.execute_script(HINT)
    return hint.startswith(("Move", "Bring", "Tilt")) and "No board" not in sentence


def write(path: Path, picture: object, width: int) -> None:
    """A PNG of few colours."""
    from PIL import Image

    image = Image.fromarray(picture[:, :, ::-1])
    image = image.resize((width, round(image.height * width / image.width)), Image.Resampling.LANCZOS)
    image.quantize(COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(path, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
