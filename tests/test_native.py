"""How kernels are called: a wrong call raises, and never crashes. The tables of kernels say what there is, so that a
new one is covered by itself."""

import contextlib
import itertools
import re
import sys
from functools import partial
from importlib import import_module
from typing import NamedTuple

import cv2
import numpy as np
import pytest
from tests.precision import window_pixels

from rcdn import geometry, native
from rcdn.config import DetectorConfig
from rcdn.detector import Detector
from rcdn.errors import RcdnError
from rcdn.geometry import division, elementary, polygon
from rcdn.native import bind
from rcdn.synthetic import Background, BoardSpec, Scene, render
from rcdn.targets.families import families
from rcdn.types import Camera

edges, fragments, local = (import_module(f"rcdn.boards.{name}") for name in ("edges", "fragments", "local"))
gains, rectify = (import_module(f"rcdn.targets.{name}") for name in ("gains", "rectify"))
bundle, solver, start = (import_module(f"rcdn.calibration.{name}") for name in ("bundle", "solver", "start"))
models = import_module("rcdn.geometry.models")
orientation, sieve, symmetry = (import_module(f"rcdn.corners.{name}") for name in ("orientation", "sieve", "symmetry"))
fit, lattice, smooth, surroundings, window = (
    import_module(f"rcdn.precision.{name}") for name in ("fit", "lattice", "smooth", "surroundings", "window")
)
KERNELS, ARGUMENTS = native._library().kernels, native._library().arguments
NUMBER = dict(float64="f8", float32="f4", int64="i8", int32="i4", int8="i1", uint8="u1")
CANARY = 64
"""bytes before and behind an array that is written to"""


class Spec(NamedTuple):
    """What a kernel takes."""

    name: str
    what: str
    type: str
    axes: int
    written: bool
    group: tuple


# ---- calls as the package makes them


def board_picture(**changes):
    spec = BoardSpec(7, 6, (0.1, 0.2, 0.3), (-3.0, -2.5, 14.0), **changes)
    return render(Scene(320, 240, 380.0, (159.5, 119.5), boards=(spec,), background=Background("plain", 3), seed=1))


def dimmed(grey, at):
    """With a spot on a corner, so that its board has to grow over it."""
    spot = cv2.circle(np.zeros(grey.shape, np.float32), np.add(at, (2, 1)).astype(int).tolist(), 7, 1.0, -1)
    share = 0.85 * cv2.GaussianBlur(spot, (0, 0), 1)
    return (grey * (1 - share) + 120 * share).astype(np.uint8)


def around(ij):
    """A small dark square beside every corner."""
    spots = surroundings.drawn(
        [surroundings.shape(np.array([0.2, 0.3]), np.array([0.2, 0.3]), np.array([[-2.0]]))],
        np.tile([0, -1, -1, -1], (len(ij), 1)), np.zeros((len(ij), 4, 2)), ij.sum(axis=1) % 2 == 0,
    )  # fmt: skip
    return surroundings.Surroundings((spots,), np.full((len(ij), 4), 0.5), ij.astype(float))


def use_the_package():
    """Whatever calls kernels."""
    grey = board_picture()
    found = Detector().detect(grey)
    board = found.boards[0]
    ij, xy = board.ij, board.xy
    Detector().detect(dimmed(grey, xy[15]))
    Detector(DetectorConfig(pattern="deltille")).detect(board_picture(pattern="deltille"))
    board_picture(coded=4, painted=((1, 2, 0.4),), swap=True)
    maps = lattice.lattice(ij, xy)
    frame = window.frames(maps, xy, np.zeros(ij.shape, bool), 1.0)
    window_pixels.windows(grey, maps, frame)
    maps.pixels(np.arange(len(xy)), np.zeros((len(xy), 2)), xy)
    fit.fit_corners(grey, ij, xy)
    fit.fit_corners(grey, ij, xy, around(ij))
    smooth.smooth(ij, xy, np.tile(np.eye(2) * 1e-3, (len(xy), 1, 1)), np.ones(len(xy), bool))
    orientation.sample_rings(grey, xy, np.full((len(xy), 3), 6.0))
    edges.sample_grey(grey, xy)
    edges.edge_contrast(grey, xy[:-1], xy[1:])
    edges.crossings(grey, xy, np.ones_like(xy), np.ones_like(xy), np.ones(len(xy)))
    grid = local.Grid({(u, v): k for k, (u, v) in enumerate(ij.tolist())}, xy)
    grid.around([(0, 0), (3, 3)], 1)
    symmetry.symmetry_centre(grey, xy, 5)
    polygon.deeper(xy[:9], xy, 1.0)
    elementary.exp(xy), elementary.log(xy), elementary.erf(xy), elementary.cos_sin(xy), elementary.arctan2(xy, xy)
    use_calibration(ij, xy)
    symmetry._room.__wrapped__(5)
    rectify.grid_with_ring(board)
    division.division_of(ij.astype(float), xy, (grey.shape[1], grey.shape[0]))
    fragments._quads(xy)
    shown = np.zeros((3, 4, 6, 6))
    gains.MarkedSquares(shown, np.indices((3, 4)).sum(axis=0) % 2 == 0, np.ones((3, 4), bool), 1).most_evidence(
        families(4)[:1], 0.0
    )


def use_calibration(ij, xy):
    """What a calibration calls: corners of a board in two frames, and projection with shifted distorted points."""
    camera = Camera(np.array([[380.0, 0, 160], [0, 380, 120], [0, 0, 1]]), np.full(5, 0.01), (320, 240))
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[:, :3, :3], poses[:, 2, 3] = geometry.rotation(np.array([[0.1, 0.2, 0.3], [0.2, 0.1, 0.3]])), 0.4
    zero = np.zeros(len(ij), int)
    corners = bundle.Corners3(ij[:, 0] % 2, zero, ij * 0.03, xy, np.ones((len(xy), 1)))
    state = bundle.State.mono(camera, poses, np.zeros((1, 3)))
    solver.solve(state, corners, np.ones(len(xy)), bundle.default_free(state), iterations=1)
    start.poses(camera, [start.Seen(ij * 0.03, xy)])
    there = np.tile([[0.1, 0.2, 1.0]], (4, 1))
    shift = np.zeros((4, 2)), np.zeros((4, 2, 3))
    models.pixels_with_jacobian(camera, there, shift)
    geometry.unproject(camera, models.pixels_of(camera, there, shift[0]))


def kept(value):
    return (
        type(value)(*map(kept, value))
        if isinstance(value, tuple)
        else value.copy()
        if isinstance(value, np.ndarray)
        else value
    )


@pytest.fixture(scope="module")
def calls():
    """Of each kernel, the arguments of a call that the package makes: the first that gives every array something."""
    seen = {}

    def recorder(name, *given):
        arrays = [a for g in given for a in (g if isinstance(g, tuple) else (g,)) if isinstance(a, np.ndarray)]
        if name not in seen or (not seen[name][1] and all(a.size for a in arrays)):
            seen[name] = tuple(kept(g) for g in given), all(a.size for a in arrays)
        return KERNELS[name](*given)

    use_the_package()  # whatever the package imports only then
    names = {id(kernel): name for name, kernel in KERNELS.items()}
    with pytest.MonkeyPatch.context() as patch:
        for module in [window_pixels, *(m for name, m in sys.modules.items() if name.startswith("rcdn."))]:
            for key, value in list(vars(module).items()):
                inner = getattr(value, "__wrapped__", value)
                if id(inner) in names:
                    spy = partial(recorder, names[id(inner)])
                    if inner is not value:
                        spy.__wrapped__ = spy
                    patch.setattr(module, key, spy)
        use_the_package()
    return {name: given for name, (given, _) in seen.items()}


def test_every_kernel_is_called(calls):
    assert set(calls) == set(KERNELS) == set(ARGUMENTS)


@pytest.mark.parametrize("name", KERNELS)
def test_no_kernel_has_more_than_a_dozen_arguments(name):
    assert len(ARGUMENTS[name]) <= 12


# ---- wrong calls


class Guarded:
    """Arguments of a call, `at` a path (of places in tuples) replaced, with canaries around all
    arrays that are written to."""

    def __init__(self, specs, given, at=(), change=None):
        self.held = []
        self.given = tuple(
            self._of(Spec(*s), g, at[1:] if at[:1] == (k,) else None, change)
            for k, (s, g) in enumerate(zip(specs, given, strict=True))
        )

    def _of(self, spec, value, at, change):
        if at == ():
            value = change
        elif spec.what == "group":
            inner = [
                self._of(Spec(*s), g, at[1:] if at and at[0] == k else None, change)
                for k, (s, g) in enumerate(zip(spec.group, value, strict=True))
            ]
            return type(value)(*inner)
        if (
            not spec.written
            or not isinstance(value, np.ndarray)
            or not value.flags.c_contiguous
            or not value.flags.writeable
        ):
            return value
        raw = np.full(2 * CANARY + value.nbytes, 0xA5, np.uint8)
        self.held.append(raw)
        out = raw[CANARY : len(raw) - CANARY].view(value.dtype).reshape(value.shape) if value.flags.aligned else value
        out[...] = value
        return out

    @property
    def whole(self):
        return all((raw[:CANARY] == 0xA5).all() and (raw[-CANARY:] == 0xA5).all() for raw in self.held)


def leaves(specs, given, at=()):
    """(path, spec, value) of all arguments, those in groups too."""
    for k, (spec, value) in enumerate(zip(specs, given, strict=True)):
        spec = Spec(*spec)
        yield (*at, k), spec, value
        if spec.what == "group":
            yield from leaves(spec.group, value, (*at, k))


def refused(calls, name, at, change, kinds, word=""):
    """Is the call refused if the argument `at` is `change`?"""
    given = Guarded(ARGUMENTS[name], calls[name], at, change)
    with pytest.raises(kinds, match=rf"{name}: .*{word}"):
        KERNELS[name](*given.given)
    assert given.whole


def harmless(calls, name, at, change):
    """Is the call refused, or does it write nothing where it mustn't?"""
    given = Guarded(ARGUMENTS[name], calls[name], at, change)
    with contextlib.suppress(ValueError, MemoryError):
        KERNELS[name](*given.given)
    assert given.whole


def arrays(calls, name):
    for at, spec, value in leaves(ARGUMENTS[name], calls[name]):
        if spec.what in ("array", "picture"):
            yield at, spec, value


def unaligned(value):
    raw = np.zeros(value.nbytes + 1, np.uint8)[1:]
    return raw.view(value.dtype).reshape(value.shape)


def apart(value):
    return np.repeat(value[..., None], 2, axis=-1)[..., 0]


def read_only(value):
    value = value.copy()
    value.flags.writeable = False
    return value


@pytest.mark.parametrize("name", KERNELS)
def test_arrays_of_another_kind_are_refused(calls, name):
    for at, spec, value in arrays(calls, name):
        check = partial(refused, calls, name, at, kinds=TypeError, word=rf"{spec.name} must be a contiguous")
        right = ("u1", "f4") if spec.what == "picture" else (NUMBER[spec.type],)
        for kind in ("f8", "f4", "f2", "i8", "i4", "i2", "i1", "u1", "u8", "?", "c16", "S1", "M8[s]"):
            if kind not in right:
                check(np.zeros(value.shape, kind))
        for wrong in (value.tolist(), None, 3.0, "array", object()):
            check(wrong)
        if value.dtype.itemsize > 1:
            check(value.astype(value.dtype.newbyteorder()))
            if value.size:
                check(unaligned(value))
        if value.size > 1:
            check(apart(value))
            check(value[..., ::-1] if value.shape[-1] > 1 else value[::-1])
        if spec.written:
            check(read_only(value))


def shapes_of(name):
    """What the signature says of the dimensions of arrays: {path: (expressions)}; those in groups are left out."""
    text, out = KERNELS[name].__doc__, {}
    given = [entry for entry in entries(text) if entry[0] not in ("SIZE", "LET", "WHERE")]
    for k, (tag, *rest) in enumerate(given):
        if tag in ("IN", "OUT"):
            out[k,] = tuple(rest[2:])
        elif tag == "WITHIN":
            out[k,] = tuple(rest[4:])
    return out


def entries(text):
    """The entries of a signature, each a list of what stands between its commas."""
    depth, part, out = 0, "", []
    for sign in text:
        depth += (sign == "(") - (sign == ")")
        if depth == 0 and sign == ")":
            out.append(split(part))
            part = ""
        elif depth >= 1 and not (depth == 1 and sign == "("):
            part += sign
    return out


def split(text):
    depth, out = 0, [""]
    for sign in text:
        depth += (sign == "(") - (sign == ")")
        if sign == "," and depth == 0:
            out.append("")
        else:
            out[-1] += sign
    return [part.strip() for part in out]


def tied(name):
    """(path, axis) whose lengths constants or other arrays settle."""
    shapes = shapes_of(name)
    own = {
        (at, axis): set(re.findall(r"[A-Za-z_.]+", text))
        for at, shape in shapes.items()
        for axis, text in enumerate(shape)
    }
    for (at, axis), words in own.items():
        rough = {place for place in own if "/" in shapes[place[0]][place[1]]}  # rounded: settles no length
        others = set().union(*(w for place, w in own.items() if place[0] != at and place not in rough))
        if words & others or all(word.isupper() for word in words):
            yield at, axis


@pytest.mark.parametrize("name", KERNELS)
def test_named_dimensions_agree(calls, name):
    known = {at: value for at, _, value in arrays(calls, name)}
    for at, axis in tied(name):
        value = known[at]
        longer = np.concatenate([value, value.take([0], axis=axis)], axis=axis) if value.shape[axis] else None
        for wrong in (value.take(range(value.shape[axis] - 1), axis=axis) if value.shape[axis] else None, longer):
            if wrong is not None:
                refused(calls, name, at, np.ascontiguousarray(wrong), ValueError)


@pytest.mark.parametrize("name", KERNELS)
def test_no_shape_leads_astray(calls, name):
    for at, _, value in arrays(calls, name):
        for wrong in (value[None], value.reshape(-1) if value.ndim > 1 else value[:, None]):
            refused(calls, name, at, wrong, ValueError)
        for axis in range(value.ndim):
            size = value.shape[axis]
            for length in {0, 1, size // 2, size - 1, size + 1, size + 7}:
                if 0 <= length != size:
                    wrong = value.take(np.arange(length) % size, axis=axis) if size else np.zeros(length, value.dtype)
                    if wrong.ndim == value.ndim:
                        harmless(calls, name, at, np.ascontiguousarray(wrong))


@pytest.mark.parametrize("name", KERNELS)
def test_no_content_leads_astray(calls, name):
    """Numbers that are used as indices, or become some, whatever they are."""
    for at, _, value in arrays(calls, name):
        if not value.size or value.dtype == np.uint8:
            continue
        real = value.dtype.kind == "f"
        limits = (
            (np.nan, np.inf, -np.inf, 1e300, -1e300, -1e9, 0.0)
            if real
            else (np.iinfo(value.dtype).min, np.iinfo(value.dtype).max, -2, 1 << 20, 0)
        )
        for number in limits:
            with np.errstate(all="ignore"):
                number = np.array(number).astype(value.dtype)
            for spot in (0, -1, slice(None)):
                wrong = value.copy()
                wrong.reshape(-1)[spot] = number
                harmless(calls, name, at, wrong)


@pytest.mark.parametrize("name", KERNELS)
def test_numbers_are_numbers_within_limits(calls, name):
    for at, spec, _ in leaves(ARGUMENTS[name], calls[name]):
        if spec.what == "int":
            for wrong in (2.5, "2", None, np.zeros(2), np.float64(1)):
                refused(calls, name, at, wrong, TypeError, f"{spec.name} must be a whole number")
            for wrong in (-(1 << 40), 1 << 40, 1 << 70, -(1 << 70)):
                refused(calls, name, at, wrong, ValueError, spec.name)
            for number in range(-2, 120):
                harmless(calls, name, at, number)
        elif spec.what == "real":
            for wrong in ("2", None, 1j):
                refused(calls, name, at, wrong, TypeError, f"{spec.name} must be a number")
            for number in (np.nan, np.inf, -np.inf, 1e308, -1e308, 0.0, -1.0):
                harmless(calls, name, at, number)


@pytest.mark.parametrize("name", KERNELS)
def test_groups_are_tuples_of_what_they_hold(calls, name):
    for at, spec, value in leaves(ARGUMENTS[name], calls[name]):
        if spec.what == "group":
            for wrong in (list(value), tuple(value)[:-1], (*value, 1), None, value[0]):
                refused(calls, name, at, wrong, TypeError, f"{spec.name} must be a tuple")
            assert value._fields == tuple(inner[0] for inner in spec.group)


@pytest.mark.parametrize("name", KERNELS)
def test_what_is_written_to_is_nothing_else(calls, name):
    known = list(arrays(calls, name))
    for (_at, spec, one), (_, _, other) in itertools.permutations(known, 2):
        if spec.written and one.size and other.size:
            raw = np.zeros(max(one.nbytes, other.nbytes), np.uint8)
            views = {id(a): raw[: a.nbytes].view(a.dtype).reshape(a.shape) for a in (one, other)}

            def swapped(value, views=views):
                return type(value)(*map(swapped, value)) if isinstance(value, tuple) else views.get(id(value), value)

            with pytest.raises(ValueError, match=f"{name}: .*share memory"):
                KERNELS[name](*map(swapped, calls[name]))


@pytest.mark.parametrize("name", KERNELS)
def test_the_number_of_arguments_is_told(calls, name):
    for wrong in (calls[name][:-1], (*calls[name], 0), ()):
        if len(wrong) != len(ARGUMENTS[name]):
            with pytest.raises(TypeError, match=f"{name} needs {len(ARGUMENTS[name])} arguments, not {len(wrong)}"):
                KERNELS[name](*wrong)


# ---- right calls


def depth(**changes):
    """`rcdn_depth` of a point in a square, with some arguments replaced."""
    given = {"polygon": np.array([[0.0, 0], [4, 0], [4, 4], [0, 4]]), "xy": np.array([[1.0, 2]]), "out": np.zeros(1)}
    given |= changes
    bind("rcdn_depth")(*given.values())
    return given["out"]


def test_a_kernel_writes_where_it_is_told():
    assert depth() == 1
    assert (
        depth(polygon=read_only(np.array([[0.0, 0], [4, 0], [4, 4], [0, 4]]))) == 1
    )  # what is only read needn't be writable


def test_empty_arrays_pass():
    assert depth(xy=np.zeros((0, 2)), out=np.zeros(0)).shape == (0,)


def test_numpy_numbers_are_numbers():
    room = bind("rcdn_symmetry_room")
    assert room(np.int64(5)) == room(np.uint8(5)) == room(5) > 0


def test_a_message_has_the_shapes():
    with pytest.raises(ValueError, match=r"^rcdn_depth: depth must be of shape \(m\) = \(1,\), not \(3,\)$"):
        depth(out=np.zeros(3))


def test_arrays_are_let_go():
    """Neither a call nor a refusal keeps hold of what it was given."""
    good, bad, out = np.zeros((3, 2)), np.zeros((3, 2), np.float32), np.zeros(3)
    before = [sys.getrefcount(a) for a in (good, bad, out)]
    for _ in range(50):
        depth(xy=good, out=out)
        with pytest.raises(TypeError):
            depth(xy=good, polygon=bad)
    assert [sys.getrefcount(a) for a in (good, bad, out)] == before


# ---- what both sides must know


def test_constants_that_disagree_raise(monkeypatch):
    """More polynomials than the kernels have room for: of old, a crash."""
    ij = np.stack(np.meshgrid(np.arange(16), np.arange(14)), axis=-1).reshape(-1, 2)
    given = ij, ij * 20.0, np.tile(np.eye(2), (len(ij), 1, 1)), np.ones(len(ij), bool)
    smooth.smooth(*given)
    monkeypatch.setattr(smooth, "DEGREE", 12)
    monkeypatch.setattr(smooth, "TOTAL", 14)
    decays = np.array(smooth.DECAYS)[:, None, None] ** (np.arange(15) - 2.0)
    monkeypatch.setattr(smooth, "_PRIORS", np.array(smooth.WIDTHS)[:, None] * decays)
    for cache in (smooth._polynomials, smooth._pairs):
        cache.cache_clear()
    try:
        with pytest.raises(ValueError, match=r"rcdn_smooth_normal: it must hold that are_terms\(terms\)"):
            smooth.smooth(*given)
    finally:
        for cache in (smooth._polynomials, smooth._pairs):
            cache.cache_clear()


@pytest.mark.parametrize("change", [-1, 1])
def test_sizes_that_disagree_raise(monkeypatch, change):
    picture, ij = (
        np.zeros((48, 64), np.uint8),
        np.stack(np.meshgrid(np.arange(5), np.arange(5)), axis=-1).reshape(-1, 2),
    )
    xy = ij * 10.0
    uses = {
        (sieve, "CELL"): lambda: sieve.cells_with_saddles(picture),
        (window, "FRAME"): lambda: window.frames(lattice.lattice(ij, xy), xy, np.zeros(ij.shape, bool), 1.0),
        (lattice, "TERMS"): lambda: lattice.lattice(ij, xy),
        (lattice, "REACH"): lambda: lattice.lattice(ij, xy) if change > 0 else lattice._lattice(*[0] * 9),
        (orientation, "HALF_TURN"): lambda: orientation.sample_rings(picture, xy, np.ones((len(xy), 3))),
        (smooth, "HOMOGRAPHY"): lambda: smooth.sheet_of(ij, xy, np.tile(np.eye(2), (len(ij), 1, 1))),
    }
    for (module, name), use in uses.items():
        with monkeypatch.context() as patch:
            patch.setattr(module, name, getattr(module, name) + change)
            orientation.directions.cache_clear()
            with pytest.raises((ValueError, TypeError), match="rcdn_"):
                use()
    orientation.directions.cache_clear()


def test_c_has_the_constants_that_python_uses():
    assert native.constants("smooth")["PANEL"] == smooth.TILE
    assert native.constants("network")["CELL"] == sieve.CELL
    with pytest.raises(KeyError):
        native.constants("smooth")["NOTHING"]


class Wrong(NamedTuple):
    flat: object
    terms: object
    origin: object


def test_groups_with_other_fields_are_no_groups():
    with pytest.raises(AttributeError, match="Wrong must have the fields flat, origin, terms"):
        bind("rcdn_lattice_map", Wrong)
    with pytest.raises(ValueError, match="zip"):
        bind("rcdn_lattice_map")


def test_an_unknown_kernel_is_an_attribute_error():
    with pytest.raises(AttributeError, match="rcdn_nothing"):
        bind("rcdn_nothing")


def test_a_missing_library_is_told(monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(native, "import_module", missing)
    with pytest.raises(RcdnError, match="install it again"):
        native._library.__wrapped__()
