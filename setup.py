"""The compiled part: one library of plain C kernels for Python's stable ABI. All else is in pyproject.toml."""

import sys
from glob import glob

from setuptools import Extension, setup

FLAGS = [
    "-O3", "-std=c11", "-ffp-contract=off", "-fvisibility=hidden", "-fno-math-errno", "-fno-trapping-math",
    "-g0", "-Wall", "-Wno-unknown-pragmas", "-Wno-psabi",
]  # fmt: skip
"""every operation rounds by itself, in the order written: the same bits on every processor (docs/decisions/0020)"""

native = Extension(
    "rcdn._native",
    sorted(glob("src/native/*.c")),
    depends=sorted(glob("src/native/*.h")),
    extra_compile_args=FLAGS,
    libraries=[] if sys.platform == "win32" else ["m"],
    py_limited_api=True,
)

setup(ext_modules=[native], options={"bdist_wheel": {"py_limited_api": "cp311"}})
