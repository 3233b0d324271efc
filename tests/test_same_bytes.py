"""The same bytes on every processor: the kernels that this one takes, against the same C without any vector
code, number after number."""

import json
import math
import os
import shutil
import subprocess
import sys
import sysconfig
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

sys.path.append(str(Path(__file__).parent))
from detection_bytes import pictures
from rcdn.geometry import elementary
from rcdn.geometry.matrices import affine, inverse, product

HERE = Path(__file__).parent
SOURCES = sorted((HERE.parent / "src" / "native").glob("*.c"))
STRICT = [
    "-std=c11",
    "-ffp-contract=off",
    "-fPIC",
    "-fvisibility=hidden",
    "-w",
    f"-I{sysconfig.get_paths()['include']}",
]
"""what makes the compiler keep to the order and the roundings that are written down"""


NATIVE = import_module("rcdn._native")
LEVELS = NATIVE.levels
"""of this kind of processor"""


def older_packages():
    """What tells NumPy, its BLAS and OpenCV to take their oldest kernels, as far as they can be told."""
    disabled = " ".join(name for name in __cpu_dispatch__ if __cpu_features__.get(name))
    return {"NPY_DISABLE_CPU_FEATURES": disabled, "OPENBLAS_CORETYPE": "Nehalem", "OPENCV_CPU_DISABLE": "AVX2"}


def build(folder, flags):
    """A library of the kernels, compiled with `flags`."""
    compiler = shutil.which(os.environ.get("CC", "cc"))
    if not compiler or os.name == "nt":
        pytest.skip("no C compiler that takes gcc's options")

    def compiled(source):
        out = folder / f"{source.stem}.o"
        subprocess.run([compiler, *STRICT, *flags, "-c", source, "-o", out], check=True)
        return out

    with ThreadPoolExecutor(2) as pool:
        objects = list(pool.map(compiled, SOURCES))
    library = folder / "_native.abi3.so"
    loose = ["-undefined", "dynamic_lookup"] if sys.platform == "darwin" else []
    subprocess.run([compiler, "-shared", *loose, *objects, "-lm", "-o", library], check=True)
    return library


def digests(library, shown, **environment):
    command = [sys.executable, HERE / "detection_bytes.py", library, shown]
    out = subprocess.run(command, env=os.environ | environment, stdout=subprocess.PIPE, check=True, text=True)
    return json.loads(out.stdout)


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """A file of the pictures, rendered once: drawing may round otherwise on another processor."""
    path = tmp_path_factory.mktemp("pictures") / "pictures.npz"
    np.savez(path, **pictures())
    return path


@pytest.fixture(scope="module")
def installed(shown):
    """What the installed kernels find."""
    found = digests(NATIVE.__file__, shown)
    for name in ("easy", "blurred", "several", "small", "deltille", "float"):
        assert found[f"{name}: boards"], name  # else nothing is compared
    return found


@pytest.mark.parametrize("level", LEVELS[:-1])
def test_every_level_of_the_installed_kernels_finds_the_same_bytes(level, shown, installed):
    if LEVELS.index(level) >= LEVELS.index(NATIVE.level):
        pytest.skip(f"this processor's level is {NATIVE.level}")
    assert digests(NATIVE.__file__, shown, RCDN_LEVEL=level) == installed


def test_plain_c_finds_the_same_bytes(shown, installed, tmp_path):
    """Without any vector code, and with other kernels of NumPy, of its BLAS and of OpenCV."""
    assert digests(build(tmp_path, ["-O1", "-DONE_LEVEL"]), shown, **older_packages()) == installed


def test_a_level_that_there_is_not_is_told():
    command = [sys.executable, "-c", "import rcdn; rcdn.Detector()"]
    out = subprocess.run(command, env=os.environ | {"RCDN_LEVEL": "sse9"}, capture_output=True, check=False, text=True)
    assert f"RcdnError: RCDN_LEVEL must be one of {NATIVE.levels}" in out.stderr


@pytest.mark.parametrize(
    ("own", "numpys", "values", "units"),
    [
        (elementary.exp, np.exp, np.linspace(-700, 700, 9999), 2),
        (elementary.log, np.log, np.exp(np.linspace(-700, 700, 9999)), 4),
        (elementary.log, np.log, np.linspace(0.9, 1.1, 9999), 4),
        (lambda x: elementary.cos_sin(x)[0], np.cos, np.linspace(-1.5, 1.5, 9999), 4),
        (lambda x: elementary.cos_sin(x)[1], np.sin, np.linspace(-3, 3, 9999), 4),
    ],
    ids=["exp", "log", "log near 1", "cos", "sin"],
)
def test_elementary_functions(own, numpys, values, units):
    np.testing.assert_array_max_ulp(own(values), numpys(values), units)


def test_elementary_functions_far_out():
    assert elementary.exp([-1e9, -np.inf, np.inf, 0]).tolist() == [0, 0, np.inf, 1]
    assert elementary.log([0.0, np.inf, 1]).tolist() == [-np.inf, np.inf, 0]
    assert elementary.log(5e-324) == pytest.approx(np.log(5e-324), rel=1e-15)
    assert np.isnan([*elementary.exp([np.nan]), *elementary.log([np.nan, -1]), *elementary.cos_sin(np.inf)]).all()
    cosine, sine = elementary.cos_sin(np.linspace(-9e5, 9e5, 9999))
    np.testing.assert_allclose(np.hypot(cosine, sine), 1, rtol=1e-15)
    np.testing.assert_allclose(sine, np.sin(np.linspace(-9e5, 9e5, 9999)), atol=1e-15)


def test_the_error_function():
    x = np.concatenate([np.linspace(-7, 7, 9999), [-np.inf, np.inf]])
    np.testing.assert_allclose(elementary.erf(x), [math.erf(v) for v in x], atol=1e-15, rtol=0)
    assert np.isnan(elementary.erf(np.nan))


def test_angles():
    angle = np.linspace(-3.14159, 3.14159, 9999)
    y, x = 3 * np.sin(angle), 3 * np.cos(angle)
    np.testing.assert_allclose(elementary.arctan2(y, x), np.arctan2(y, x), atol=1e-15)
    assert elementary.arctan2([0, 0, 0, 2, -2], [0, 1, -1, 0, 0]).tolist() == [0, 0, np.pi, np.pi / 2, -np.pi / 2]


@pytest.mark.parametrize("shape", [(7, 2, 2), (3, 3)])
def test_small_matrices(shape):
    a, b = np.random.default_rng(0).normal(size=(2, *shape))
    np.testing.assert_allclose(product(a, b), a @ b, atol=1e-14)
    np.testing.assert_allclose(inverse(a), np.linalg.inv(a), rtol=1e-10)
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        inverse(np.zeros(shape))


@pytest.mark.parametrize("size", [(5, 7), (1, 6)])
def test_affine_maps_are_least_squares(size):
    """Of a single row of points, too: the smallest map of many."""
    rng = np.random.default_rng(1)
    ij = np.array([3, 4]) + np.argwhere(np.ones(size))
    xy = ij @ rng.normal(size=(2, 2)) + 40 + rng.normal(size=(len(ij), 2))
    design = np.column_stack([ij - ij.mean(axis=0), np.ones(len(ij))])
    expected = np.linalg.lstsq(design, xy, rcond=None)[0].T
    expected[:, 2] -= expected[:, :2] @ ij.mean(axis=0)
    np.testing.assert_allclose(affine(ij, xy), expected, atol=1e-9)
