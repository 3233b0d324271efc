"""docs/python.md, run from top to bottom: what it says is printed is printed."""

import re

import numpy as np
import pytest
from tests.doc_blocks import ROOT, run

pytestmark = pytest.mark.xdist_group("python page")  # one run of the page
PAGE = (ROOT / "docs/python.md").read_text()
PAIRS = re.findall(r"^```python\n(.*?)^```\n^```text\n(.*?)^```$", PAGE, flags=re.M | re.S)
BREAK = "==== next ===="
WHOLE = re.compile(r"[-+]?\d+")
NUMBER = re.compile(r"[-+]?\d*\.\d+(?:e[-+]?\d+)?|[-+]?\d+(?:e[-+]?\d+)?")


def same(stated, printed):
    """Whether two texts have the same words and whole numbers, and other numbers that agree to 2 % (or .02)."""
    words = [NUMBER.sub(_word, text).split() for text in (stated, printed)]
    numbers = [
        np.array([n for n in NUMBER.findall(text) if not WHOLE.fullmatch(n)], float) for text in (stated, printed)
    ]
    return words[0] == words[1] and np.allclose(*numbers, rtol=0.02, atol=2e-6 + 0.02 * (np.abs(numbers[0]) > 1))


def _word(number):
    return number[0] if WHOLE.fullmatch(number[0]) else "#"


def test_other_texts_are_told_apart():
    assert same("<Camera: fx 545.49, k1 -0.20492>", "<Camera:  fx 545.5, k1 -0.20491>")
    assert not same("fx 545.49", "fx 565.49")
    assert not same("k1 -0.2049", "k1 0.2049")
    assert not same("True", "False")
    assert not same("1 2", "1 2 3")
    assert not same("55 corners", "54 corners")


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """What each block prints, in one program."""
    folder = tmp_path_factory.mktemp("tour")
    run(folder, "-m", "rcdn", "render", "photos", "--one-camera", "--count", "12")
    return run(folder, "-c", f"print({BREAK!r})\n".join(code for code, _ in PAIRS)).split(f"{BREAK}\n")


def test_every_block_of_python_says_what_it_prints():
    assert len(PAIRS) == PAGE.count("```python\n") == PAGE.count("```text\n") > 8


@pytest.mark.parametrize("number", range(len(PAIRS)))
def test_the_page_prints_what_it_says(printed, number):
    assert len(printed) == len(PAIRS)
    assert same(PAIRS[number][1], printed[number]), printed[number]
