"""The kernels compiled for other systems and processors, and run there or in an emulator:
calls of detections here must give the same bits. Slow tests: `python -m pytest tests/replay -m slow`."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1]))
from detection_bytes import pictures

ROOT = Path(__file__).parents[2]
SOURCES = [p for p in sorted((ROOT / "src" / "native").glob("*.c")) if p.name != "module.c"]
FLAGS = ["-O2", "-std=c11", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-w"]
PLATFORMS = {
    "aarch64": (["aarch64-linux-gnu-gcc", "-static"], ["qemu-aarch64"]),
    "musl": (["musl-gcc", "-static"], []),
    "windows": (["x86_64-w64-mingw32-gcc"], ["wine"]),
    "zig-musl": (["python-zig", "cc", "-target", "x86_64-linux-musl"], []),
    "zig-windows": (["python-zig", "cc", "-target", "x86_64-windows-gnu"], ["wine"]),
}
"""compiler, and what runs the programs it makes: Debian's packages gcc-aarch64-linux-gnu, qemu-user, musl-tools,
gcc-mingw-w64-x86-64 and wine64, and ziglang of PyPI"""


@pytest.fixture(scope="module")
def calls(tmp_path_factory):
    """A file of calls of the installed kernels, and what they gave."""
    folder = tmp_path_factory.mktemp("calls")
    np.savez(folder / "pictures.npz", **pictures())
    command = [sys.executable, Path(__file__).with_name("record.py"), folder / "pictures.npz", folder / "calls"]
    subprocess.run(command, check=True, cwd=ROOT)
    return folder / "calls"


@pytest.mark.parametrize("platform", PLATFORMS)
def test_every_level_gives_the_same_bits(platform, calls, tmp_path):
    (compiler, *options), runner = PLATFORMS[platform]
    lacking = [name for name in (compiler, *runner) if not shutil.which(name)]
    if lacking:
        pytest.skip(f"not here: {', '.join(lacking)}")
    program = tmp_path / "replay.exe"
    source = Path(__file__).with_name("replay.c")
    include = f"-I{ROOT / 'src' / 'native'}"
    subprocess.run([compiler, *options, *FLAGS, include, source, *SOURCES, "-lm", "-o", program], check=True)
    for level in ("baseline", "avx2", "avx512", "vnni"):  # those that aren't there are the best that is
        environment = os.environ | {"RCDN_LEVEL": level, "WINEDEBUG": "-all"}
        done = subprocess.run([*runner, program, calls], env=environment, check=False, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout[-2000:]
        assert " calls, 0 differ" in done.stdout
