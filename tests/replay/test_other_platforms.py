"""The kernels compiled for other systems and processors, and run there or in an emulator:
calls of detections here must give the same bits. Slow tests: `python -m pytest tests/replay -m slow`."""

import os
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1]))
from detection_bytes import pictures

ROOT = Path(__file__).parents[2]
NATIVE = import_module("rcdn._native")
SOURCES = [p for p in sorted((ROOT / "src" / "native").glob("*.c")) if p.name != "module.c"]
FLAGS = ["-O2", "-std=c11", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-w"]
X86 = ("baseline", "avx2", "avxvnni", "avx512", "vnni")
ARM = ("baseline", "dotprod")
PLATFORMS = {
    "aarch64": (["aarch64-linux-gnu-gcc", "-static"], ["qemu-aarch64"], ARM),
    "zig-aarch64": (["python-zig", "cc", "-target", "aarch64-linux-musl"], ["qemu-aarch64"], ARM),
    "musl": (["musl-gcc", "-static"], [], X86),
    "windows": (["x86_64-w64-mingw32-gcc"], ["wine"], ("baseline",)),
    "zig-musl": (["python-zig", "cc", "-target", "x86_64-linux-musl"], [], X86),
    "zig-windows": (["python-zig", "cc", "-target", "x86_64-windows-gnu"], ["wine"], X86),
}
"""compiler, what runs the programs it makes, levels: Debian's packages gcc-aarch64-linux-gnu, qemu-user, musl-tools,
gcc-mingw-w64-x86-64 and wine64, and ziglang of PyPI"""


def recorded(folder, shown, *kernels):
    """A file of calls of the installed kernels (all, or those named) in detections on pictures, and what they gave."""
    np.savez(folder / "pictures.npz", **shown)
    command = [sys.executable, Path(__file__).with_name("record.py"), folder / "pictures.npz", folder / "calls"]
    subprocess.run([*command, *kernels], check=True, cwd=ROOT)
    return folder / "calls"


@pytest.fixture(scope="module")
def calls(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("calls"), pictures())


def built(folder, platform):
    """The program that makes recorded calls, and what runs it; skips where a tool is missing."""
    (compiler, *own), runner, _ = PLATFORMS[platform]
    lacking = [name for name in (compiler, *runner) if not shutil.which(name)]
    if lacking:
        pytest.skip(f"not here: {', '.join(lacking)}")
    return compiled([compiler, *own], folder / "replay.exe"), runner


def compiled(compiler, program, sources=SOURCES):
    source = Path(__file__).with_name("replay.c")
    include = f"-I{ROOT / 'src' / 'native'}"
    subprocess.run([*compiler, *FLAGS, include, source, *sources, "-lm", "-o", program], check=True)
    return program


def replayed(command, calls, **environment):
    """The level that the program took; all calls must give what they gave."""
    environment = os.environ | {"WINEDEBUG": "-all"} | environment
    done = subprocess.run([*command, calls], env=environment, check=False, capture_output=True, text=True)
    assert done.returncode == 0, (done.stdout + done.stderr)[-2000:]
    level, said = done.stdout.splitlines()[-1].split(": ")
    assert said.endswith(" calls, 0 differ")
    return level


@pytest.mark.parametrize("platform", PLATFORMS)
def test_every_level_gives_the_same_bits(platform, calls, tmp_path):
    program, runner = built(tmp_path, platform)
    levels = PLATFORMS[platform][2]
    for most in levels:  # those that aren't there are the best that is
        level = replayed([*runner, program], calls, RCDN_LEVEL=most)
        assert levels.index(level) <= levels.index(most)


def test_dot_products_are_taken_where_the_processor_has_them(calls, tmp_path):
    program, runner = built(tmp_path, "aarch64")
    for processor, level in {"cortex-a57": "baseline", "max": "dotprod"}.items():
        assert replayed([*runner, "-cpu", processor, program], calls) == level


@pytest.mark.skipif(sys.platform != "linux" or "avx2" not in NATIVE.levels, reason="emulated on x86-64 Linux only")
def test_avx_vnni_gives_the_same_bits(tmp_path):
    """Its one instruction is emulated where the processor has none: a tiny picture, since that takes 10 µs each."""
    gcc = shutil.which("gcc") and subprocess.run(["gcc", "-dumpversion"], capture_output=True, text=True, check=True)
    if NATIVE.level == "baseline" or not gcc or int(gcc.stdout.split(".")[0]) < 11:
        pytest.skip("needs AVX2 and gcc 11")
    few = recorded(tmp_path, {"tiny": pictures()["easy"][158:174, 200:216]}, "rcdn_network")
    emulation = Path(__file__).with_name("avx_vnni.h")
    network = [p for p in SOURCES if p.stem in ("network", "levels")]
    program = compiled(["gcc", "-D_GNU_SOURCE", "-include", emulation], tmp_path / "replay.exe", network)
    assert replayed([program], few, RCDN_LEVEL="avxvnni") == "avxvnni"
    assert replayed([program], few, RCDN_LEVEL="avx2") == "avx2"
