"""`python tools/build_windows_wheel.py WHEEL [--out FOLDER]`: the wheel of Windows, x86-64, made of one of Linux: its
Python files, and the kernels compiled by zig, a clang that brings Windows' headers and libraries along. Runs on Linux.

The module needs python3.dll alone, the stable ABI of every CPython from 3.11 on. Needs
`pip install wheel abi3audit ziglang`, and Python's headers.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from try_wheel import run

ROOT = Path(__file__).parents[1]
LARGEST = 2_000_000
"""bytes of a wheel"""
ZIG = (sys.executable, "-m", "ziglang")
TARGET = ("-target", "x86_64-windows-gnu")
PYTHON = re.compile(rb"__imp_(_?Py\w+)")


def flags() -> list[str]:
    """What setup.py compiles with."""
    (listed,) = re.findall(r"^FLAGS = \[(.*?)\]", (ROOT / "setup.py").read_text(), re.MULTILINE | re.DOTALL)
    return re.findall(r'"(.*?)"', listed)


def headers(folder: Path) -> Path:
    """Python's, but for the one that tells of this system."""
    shutil.copytree(sysconfig.get_paths()["include"], folder, ignore=shutil.ignore_patterns("pyconfig*.h"))
    return folder


def python3_library(module: Path, folder: Path) -> Path:
    """The import library of what the compiled module takes from python3.dll."""
    names = sorted({name.decode() for name in PYTHON.findall(module.read_bytes())})
    listed = folder / "python3.def"
    listed.write_text("\n".join(["LIBRARY python3.dll", "EXPORTS", *names]) + "\n")
    run(*ZIG, "dlltool", "-m", "i386:x86-64", "-d", listed, "-l", folder / "libpython3.a")
    return folder / "libpython3.a"


def compiled(folder: Path) -> Path:
    """The module of the kernels, for Windows."""
    include = headers(folder / "include")

    def one(source: Path) -> Path:
        out = folder / f"{source.stem}.o"
        options = (*TARGET, *flags(), f"-I{ROOT / 'tools' / 'windows'}", f"-I{include}")
        run(*ZIG, "cc", *options, "-c", source, "-o", out)
        return out

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        objects = list(pool.map(one, sorted((ROOT / "src" / "native").glob("*.c"))))
    library = python3_library(folder / "module.o", folder)
    run(*ZIG, "cc", *TARGET, "-shared", "-s", *objects, library, "-o", folder / "_native.pyd")
    return folder / "_native.pyd"


def built(linux: Path, out: Path) -> Path:
    """The wheel in `out`."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run(sys.executable, "-m", "wheel", "unpack", linux, "--dest", folder / "wheel")
        (unpacked,) = (folder / "wheel").iterdir()
        for library in (unpacked / "rcdn").glob("_native*"):
            library.unlink()
        shutil.rmtree(unpacked / "rcdn.libs", ignore_errors=True)
        (facts,) = unpacked.glob("*.dist-info/WHEEL")
        kept = [line for line in facts.read_text().splitlines() if line and not line.startswith("Tag:")]
        facts.write_text("\n".join([*kept, "Tag: cp311-abi3-win_amd64", ""]))
        for listed in unpacked.glob("*.dist-info/sboms"):
            shutil.rmtree(listed)  # auditwheel's, of the Linux wheel
        (unpacked / "rcdn" / "_native.pyd").write_bytes(compiled(folder).read_bytes())
        run(sys.executable, "-m", "wheel", "pack", unpacked, "--dest-dir", folder)
        (wheel,) = folder.glob("*-win_amd64.whl")
        run(Path(sys.executable).with_name("abi3audit"), "--strict", wheel)
        out.mkdir(parents=True, exist_ok=True)
        return Path(shutil.copy(wheel, out))


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("wheel", type=Path)
    parser.add_argument("--out", type=Path, default=ROOT / "dist")
    given = parser.parse_args()
    try:
        wheel = built(given.wheel, given.out)
    except subprocess.CalledProcessError as error:
        raise SystemExit(f"{error}: {error.stdout}") from error
    size = wheel.stat().st_size
    print(f"{wheel.name}: {size / 1e6:.2f} MB")
    if size > LARGEST:
        raise SystemExit(f"that is more than {LARGEST / 1e6:g} MB")


if __name__ == "__main__":
    main()
