"""The code of documentation pages, as it is printed there."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def blocks(page, language):
    """The fenced blocks of a page ("" for those without a language), in order."""
    found = re.findall(r"^```(\w*)\n(.*?)^```$", (ROOT / page).read_text(), flags=re.M | re.S)
    return [text for name, text in found if name == language]


def commands(page):
    """Each `rcdn …` line of a page's blocks of commands, as its words, without comments; lines with && are several."""
    text = "\n".join(re.sub(r"(?:^|\s)#.*$", "", block, flags=re.M) for block in blocks(page, ""))
    parts = (shlex.split(part) for line in text.splitlines() for part in line.split("&&"))
    return [words for words in parts if words and words[0] == "rcdn"]


def run(folder, *words):
    """Standard output of a Python program in a folder; it must end well."""
    done = subprocess.run([sys.executable, *words], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{words}: {done.stdout}{done.stderr}"
    return done.stdout
