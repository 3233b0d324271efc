"""The compiled part: one library of plain C kernels for Python's stable ABI. All else is in pyproject.toml."""

import os
import sys
from concurrent.futures import ThreadPoolExecutor
from glob import glob

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

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


class BuildExtension(build_ext):
    """Compiles the sources side by side, as many as there are cores."""

    def build_extensions(self):
        one_by_one = self.compiler.compile

        def side_by_side(sources, **settings):
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                return [o for made in pool.map(lambda source: one_by_one([source], **settings), sources) for o in made]

        if self.compiler.compiler_type == "unix":  # Microsoft's sets itself up with the first source
            self.compiler.compile = side_by_side
        super().build_extensions()


setup(
    ext_modules=[native],
    cmdclass={"build_ext": BuildExtension},
    options={"bdist_wheel": {"py_limited_api": "cp311"}},
)
