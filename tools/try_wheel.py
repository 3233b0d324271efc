"""`python tools/try_wheel.py WHEEL [--python PYTHON]... [--lab WHEEL]`: install a wheel in clean environments without a
compiler in their path, and find a board.

For each interpreter one line of JSON: seconds of the installation, from nothing to the first board, and of
`import rcdn`; megabytes. `--lab`: the laboratory's wheel, too, whose verbs are then asked for help.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

FIRST_BOARD = Path(__file__).with_name("first_board.py")
PROGRAMS = "Scripts" if os.name == "nt" else "bin"
NEEDED = ("SYSTEMROOT", "TEMP", "TMP")
"""without which Windows starts no program"""


def run(*command: str | Path, environment: dict[str, str] | None = None) -> str:
    """Standard output; raises CalledProcessError if it fails."""
    return subprocess.run(command, check=True, text=True, stdout=subprocess.PIPE, env=environment).stdout


def bare(folder: str) -> dict[str, str]:
    """An environment that knows no program but those in `folder`, and where to get packages from."""
    kept = {
        key: value
        for key, value in os.environ.items()
        if key.startswith("PIP_") or key.lower().endswith("_proxy") or key in NEEDED
    }
    return kept | {"PATH": str(Path(folder, PROGRAMS)), "CC": "no-compiler", "LANG": "C.UTF-8"}


def check_wheel(wheel: Path, python: str, lab: Path | None = None) -> None:
    """Try the wheel with one interpreter, then the laboratory's, and print what there is to say."""
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        run(python, "-m", "venv", folder)
        there, environment = Path(folder, PROGRAMS, "python"), bare(folder)
        options = ("--quiet", "--disable-pip-version-check", "--no-cache-dir", "--only-binary", ":all:")
        run(there, "-I", "-m", "pip", "install", *options, wheel, environment=environment)
        installed = time.perf_counter()
        run(there, "-I", FIRST_BOARD, environment=environment)
        found = time.perf_counter()
        again = json.loads(run(there, "-I", FIRST_BOARD, environment=environment))
        run(there.with_name("rcdn"), "--version", environment=environment)
        version = run(there, "-c", "import platform; print(platform.python_version())").strip()
        size = sum(file.stat().st_size for file in Path(folder).rglob("*") if file.is_file())
        if lab is not None:
            run(
                there,
                "-I",
                "-m",
                "pip",
                "install",
                *options,
                f"rcdn[onnx] @ {wheel.resolve().as_uri()}",
                lab,
                environment=environment,
            )
            for verb in ("evaluate", "bench"):
                run(there.with_name("rcdn"), verb, "--help", environment=environment)
    seconds = {"install": installed - began, "to first board": found - began, "import rcdn": again["import"]}
    facts = {f"{name}, s": round(value, 3) for name, value in seconds.items()}
    print(
        json.dumps({"python": version, **facts, "environment, MB": round(size / 1e6), "level": again["level"]}),
        flush=True,
    )


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("wheel", type=Path)
    parser.add_argument("--python", action="append")
    parser.add_argument("--lab", type=Path)
    given = parser.parse_args()
    for python in given.python or [sys.executable]:
        check_wheel(given.wheel, python, given.lab)


if __name__ == "__main__":
    main()
