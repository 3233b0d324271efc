"""`python -m tests.environments [NAME …]`: some of the tests in fresh environments, with the oldest and the newest
packages that are allowed, each flavour of OpenCV, and other programs' solvers. Without names: all but the solvers.
`--list` names them. See docs/install.md.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import tomllib
import venv
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
NOT_OURS = ("-W", "ignore:'click.:DeprecationWarning")
"""old releases of Typer use names that Click has given up since"""
EVERY = ("-m", "slow or not slow")
FLAVOURS = ("opencv-python", "opencv-contrib-python", "opencv-python-headless", "opencv-contrib-python-headless")
TESTS = (
    "tests/test_any_opencv.py", "tests/test_io.py", "tests/test_vnl.py", "tests/test_geometry.py",
    "tests/test_undistort.py", "tests/targets/test_opencv.py", "tests/calibration/test_solver.py",
    "tests/calibration/test_one_thread.py",
    "tests/test_detector.py::test_ordinary_boards_are_found_whole_with_right_labels_and_sub_pixel_corners[auto]",
)  # fmt: skip
SOLVERS = "tests/adapters/test_solvers.py"
RIG_FILES = "tests/cameras/test_rig_files.py"


@dataclass(frozen=True)
class Environment:
    """What pip installs, and the arguments of pytest. `apart`: the program's own environment is another one,
    found by the command of its name."""

    packages: tuple[str, ...]
    tests: tuple[str, ...]
    apart: tuple[str, ...] = ()


def requirements() -> list[str]:
    """What the project needs, as pyproject.toml says it."""
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    return [str(line) for line in wanted]


def oldest(line: str) -> str:
    """The lowest version that a requirement allows."""
    return re.sub(r">=(.*)", r"==\1.*" if line.startswith("opencv") else r"==\1", line)


def with_opencv(*packages: str) -> tuple[str, ...]:
    """The project's requirements with other packages of OpenCV."""
    return (*(line for line in requirements() if not line.startswith("opencv")), *packages)


def environments() -> dict[str, Environment]:
    """All of them by name."""
    found = {
        "oldest": Environment(tuple(map(oldest, requirements())), TESTS),
        "newest": Environment(tuple(requirements()), TESTS),
        "all-together": Environment(with_opencv(*FLAVOURS), TESTS),
    }
    for flavour in FLAVOURS:
        found[f"{flavour}-4.9"] = Environment(with_opencv(f"{flavour}==4.9.*", "numpy<2"), TESTS)
        found[f"{flavour}-newest"] = Environment(with_opencv(flavour), TESTS)
    for solver in ("lensboy", "aniposelib", "caliscope"):
        bare = tuple(line for line in requirements() if not line.startswith("opencv"))
        found[solver] = Environment((*bare, solver), (SOLVERS, RIG_FILES, "-k", solver))
    found["pycolmap"] = Environment((*requirements(), "pycolmap"), (RIG_FILES, "-k", "pycolmap"))
    own = ("multical", "numpy<1.24")
    found["multical"] = Environment(tuple(requirements()), (SOLVERS, "-k", "multical"), own)
    return found


def made(folder: Path, packages: tuple[str, ...]) -> Path:
    """The Python of a new virtual environment with `packages`."""
    venv.create(folder, with_pip=True)
    python = folder / ("Scripts" if os.name == "nt" else "bin") / "python"
    install(python, *packages)
    return python


def install(python: Path, *packages: str | Path) -> None:
    """Let the environment's own pip install them."""
    subprocess.run([python, "-m", "pip", "install", "-q", *packages], check=True, env=without_checkout())


def without_checkout() -> dict[str, str]:
    """This process's environment but for PYTHONPATH, in which pip would find this checkout, and install nothing."""
    return {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}


def tried(name: str, environment: Environment, wheels: list[Path], folder: Path) -> bool:
    """Whether the tests pass in it; says with what they ran."""
    python = made(folder / name, (*environment.packages, "pytest>=8", "hypothesis>=6", "pillow>=10"))
    install(python, "--no-deps", *wheels)  # ours, and the laboratory, whose simulated cameras the tests take
    path = os.environ["PATH"]
    if environment.apart:
        own = made(folder / f"{name}-own", environment.apart)
        path = os.pathsep.join([path, str(own.parent)])
    known = [re.split("[<>=]", line)[0] for line in (*environment.packages, name)]
    code = (
        f"from rcdn.provenance import versions\nimport cv2\nprint(cv2.__version__, versions(*{sorted(set(known))!r}))"
    )
    env = without_checkout() | {"PATH": path}
    print(f"== {name}", flush=True)
    done = subprocess.run([python, "-c", code], env=env).returncode
    tests = (*NOT_OURS, *EVERY, *environment.tests)
    done = done or subprocess.run([python, "-m", "pytest", "-q", *tests], env=env, cwd=ROOT).returncode
    print(f"== {name}: {'failed' if done else 'passed'}", flush=True)
    return done == 0


def main(names: list[str]) -> int:
    """Exit code: 0 if all pass, 1 if not, 2 for a name that isn't known."""
    known = environments()
    if unknown := [name for name in names if name not in known]:
        print("\n".join(known))
        return 0 if unknown == ["--list"] else 2
    chosen = names or [name for name, environment in known.items() if SOLVERS not in environment.tests]
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(
            [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", folder, str(ROOT), str(ROOT / "lab")],
            check=True,
        )
        wheels = sorted(Path(folder).glob("*.whl"))
        failed = [name for name in chosen if not tried(name, known[name], wheels, Path(folder))]
    print(f"{len(chosen) - len(failed)} passed, {len(failed)} failed{': ' if failed else ''}{', '.join(failed)}")
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
