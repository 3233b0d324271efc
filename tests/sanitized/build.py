"""The kernels with address and undefined-behaviour sanitizers, in a folder of their own:
never the installed library."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sysconfig
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).parents[2]
SOURCES = ROOT / "src" / "native"
BUILD = ROOT / "build" / "sanitized"
COMPILER = os.environ.get("CC", "gcc")
SANITIZERS = "address,undefined,float-cast-overflow,bounds-strict"
FLAGS = (
    "-fPIC", "-std=c11", "-O1", "-g", "-fno-omit-frame-pointer", f"-fsanitize={SANITIZERS}",
    "-ffp-contract=fast", "-fno-math-errno", "-fno-trapping-math",
    "-fno-signed-zeros", "-fassociative-math", "-freciprocal-math", "-fvisibility=hidden", "-Wno-psabi",
    "-Wno-unknown-pragmas",
)  # fmt: skip
"""undefined behaviour is told and goes on, so that one run tells all; a bad address ends it"""
LEVELLED = {"levels.c", "network.c"}
"""sources built for every level of the processor, since their code differs between levels; of others, the baseline"""


def runtime() -> list[Path] | None:
    """The sanitizers' libraries, to be loaded before all others; None if the compiler has none."""
    found = []
    for name in ("libasan.so", "libubsan.so", "libstdc++.so.6"):
        try:
            output = subprocess.run(
                [COMPILER, f"-print-file-name={name}"], capture_output=True, text=True, check=True
            ).stdout
        except (OSError, subprocess.CalledProcessError):
            return None
        path = Path(output.strip())
        if not path.is_absolute():  # a compiler that lacks it says only its name
            return None
        found.append(path.resolve())
    return found


def library() -> Path:
    """The library, built if the sources have changed since."""
    headers = b"".join(p.read_bytes() for p in sorted(SOURCES.glob("*.h")))
    BUILD.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        objects = list(pool.map(lambda source: _compiled(source, headers), sorted(SOURCES.glob("*.c"))))
    out = BUILD / "_native.abi3.so"
    subprocess.run(
        [COMPILER, "-shared", f"-fsanitize={SANITIZERS}", *map(str, objects), "-o", str(out), "-lm"], check=True
    )
    return out


def _compiled(source: Path, headers: bytes) -> Path:
    """The object file of a source; its name tells what it was made of."""
    flags = FLAGS if source.name in LEVELLED else (*FLAGS, "-DONE_LEVEL")
    made_of = hashlib.sha256(headers + source.read_bytes() + " ".join((COMPILER, *flags)).encode()).hexdigest()[:16]
    out = BUILD / f"{source.stem}-{made_of}.o"
    if not out.exists():
        for old in BUILD.glob(f"{source.stem}-*.o"):
            old.unlink()
        new = out.with_suffix(".new")
        subprocess.run(
            [COMPILER, *flags, f"-I{sysconfig.get_paths()['include']}", "-c", str(source), "-o", str(new)], check=True
        )
        new.replace(out)
    return out


if __name__ == "__main__" and runtime() is not None:
    library()
