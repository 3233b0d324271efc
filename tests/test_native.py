"""How kernels are called: nothing is converted, and what doesn't fit is told."""

import numpy as np
import pytest

from rcdn import native
from rcdn.errors import RcdnError
from rcdn.native import bind

LETTERS = {"f": np.float32, "d": np.float64, "b": np.uint8, "c": np.int8, "i": np.int32, "l": np.int64}


@pytest.fixture(scope="module")
def unpack():
    """Values as ctypes takes them."""
    return native._library()[1]


def depth(**changes):
    """`rcdn_depth` of a point in a square, with some arguments replaced."""
    given = {
        "polygon": np.array([[0.0, 0], [4, 0], [4, 4], [0, 4]]), "corners": 4, "xy": np.array([[1.0, 2]]), "points": 1,
        "out": np.zeros(1),
    }  # fmt: skip
    given |= changes
    bind("rcdn_depth", "dndnD")(*given.values())
    return given["out"]


def test_a_kernel_writes_where_it_is_told():
    assert depth() == 1


def read_only(array):
    array.flags.writeable = False
    return array


@pytest.mark.parametrize(
    "changes",
    [
        {"polygon": np.zeros((4, 2), np.float32)},
        {"polygon": np.zeros((4, 2), np.int64)},
        {"polygon": np.zeros((4, 2), ">f8")},
        {"polygon": np.zeros((4, 4))[:, ::2]},
        {"polygon": np.zeros((2, 4)).T},
        {"polygon": [[0.0, 0], [4, 0]]},
        {"polygon": None},
        {"xy": 3.0},
        {"out": np.zeros(4)[::-2]},
        {"out": np.zeros((2, 2))[:, 1]},
    ],
    ids=["float32", "int64", "other end", "apart", "transposed", "list", "None", "number", "backwards", "column"],
)
def test_other_arrays_are_refused(changes):
    with pytest.raises(TypeError, match="must be contiguous float64"):
        depth(**changes)


def test_what_is_written_to_must_be_writable():
    with pytest.raises(TypeError, match="may be written to"):
        depth(out=read_only(np.zeros(1)))
    assert depth(polygon=read_only(np.array([[0.0, 0], [4, 0], [4, 4], [0, 4]])))  # what is only read needn't


@pytest.mark.parametrize("count", [0, 4, 6])
def test_the_number_of_arguments_is_told(count):
    with pytest.raises(TypeError, match=f"needs 5 arguments, not {count}"):
        bind("rcdn_depth", "dndnD")(*[np.zeros(1)] * count)


@pytest.mark.parametrize("value", [2.5, "2", None, np.zeros(1)], ids=str)
def test_integers_must_be_integers(value):
    with pytest.raises(Exception, match="argument 2") as caught:
        depth(corners=value)
    assert type(caught.value).__name__ in ("ArgumentError", "TypeError")


@pytest.mark.parametrize("letter", LETTERS)
def test_each_letter_takes_its_type_only(unpack, letter):
    for other, kind in LETTERS.items():
        array = np.zeros((3, 2), kind)
        for form in (letter, letter.upper()):
            if other == letter:
                assert unpack(form.encode(), (array,)) == (array.ctypes.data,)
            else:
                with pytest.raises(TypeError, match=LETTERS[letter].__name__):
                    unpack(form.encode(), (array,))


@pytest.mark.parametrize("kind", [bool, np.uint16, np.uint32, np.float16, np.complex64, "S1", "datetime64[s]"])
def test_no_letter_takes_other_types(unpack, kind):
    for letter in LETTERS:
        with pytest.raises(TypeError, match="contiguous"):
            unpack(letter.encode(), (np.zeros(4, kind),))


def test_unaligned_arrays_are_refused(unpack):
    with pytest.raises(TypeError, match="contiguous float64"):
        unpack(b"d", (np.zeros(17, np.uint8)[1:].view(np.float64),))


def test_pictures(unpack):
    for kind, real in ((np.uint8, 0), (np.float32, 1)):
        grey = np.zeros((3, 5), kind)
        assert unpack(b"pn", (grey, 7)) == (grey.ctypes.data, 3, 5, real, 7)
        for other in (grey[:, 1:], grey.T, grey[None], grey[0], grey.astype(np.float64), grey.astype(np.int8)):
            with pytest.raises(TypeError, match=r"uint8 or float32 of \(H, W\)"):
                unpack(b"p", (other,))


def test_an_unknown_letter_is_told(unpack):
    with pytest.raises(TypeError, match="no known kind"):
        unpack(b"z", (np.zeros(3),))


def test_empty_arrays_pass(unpack):
    assert len(unpack(b"dpL", (np.zeros((0, 2)), np.zeros((0, 4), np.uint8), np.zeros(0, np.int64)))) == 6
    assert depth(xy=np.zeros((0, 2)), points=0, out=np.zeros(0)).shape == (0,)


def test_arrays_are_let_go(unpack):
    """Neither a call nor a refusal keeps hold of what it was given."""
    import sys

    good, bad = np.zeros((3, 2)), np.zeros((3, 2), np.float32)
    before = sys.getrefcount(good), sys.getrefcount(bad)
    for _ in range(50):
        unpack(b"d", (good,))
        with pytest.raises(TypeError):
            unpack(b"dd", (good, bad))
    assert (sys.getrefcount(good), sys.getrefcount(bad)) == before


def test_an_unknown_kernel_is_an_attribute_error():
    with pytest.raises(AttributeError, match="rcdn_nothing"):
        bind("rcdn_nothing", "n")(1)


def test_a_missing_library_is_told(monkeypatch):
    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(native, "import_module", missing)
    with pytest.raises(RcdnError, match="install it again"):
        native._library.__wrapped__()
