"""The file of a cell network's 8-bit weights: inference uses exactly the weights that `rcdn export` has tested and
stored."""

from __future__ import annotations

import hashlib
import io
import zipfile
from math import prod

import numpy as np

from rcdn.corners.cells import SHAPES, CellNetwork
from rcdn.corners.model_facts import FIX
from rcdn.errors import RcdnError

FORMS = {
    "reals": (
        np.dtype(np.float32),
        prod(SHAPES[0]) + SHAPES[0][0] + 2 * sum(s[0] for s in SHAPES[1:]) + prod(SHAPES[-1]),
    ),
    "whole": (np.dtype(np.int8), sum(prod(s) for s in SHAPES[1:-1])),
}
"""type and length of the arrays. `reals`: first layer, scales and biases of the others, last layer; `whole`: the layers
between"""


def to_npz(network: CellNetwork) -> bytes:
    """The content of a file that `read_npz` reads; the same bytes for the same weights."""
    out = io.BytesIO()
    np.savez(out, reals=network.reals, whole=network.whole)
    return out.getvalue()


def read_npz(data: bytes, sha256: object, name: str) -> CellNetwork:
    """The network in a file's content `data`.

    Raises RcdnError, which begins with the file's `name`, if the checksum or the arrays are wrong.
    """
    if hashlib.sha256(data).hexdigest() != sha256:
        raise RcdnError(f"{name} is not the file that the .json beside it describes (sha256 differs); {FIX}")
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            arrays = {key: np.ascontiguousarray(file[key]) for key in FORMS}
    except (ValueError, KeyError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise RcdnError(f"{name} holds no 8-bit weights ({error}); {FIX}") from error
    for key, (kind, length) in FORMS.items():
        if arrays[key].dtype != kind or arrays[key].shape != (length,):
            found = f"{arrays[key].dtype} {arrays[key].shape}"
            raise RcdnError(f"{name}: {key!r} must be {kind} ({length},), not {found}; {FIX}")
    if not np.isfinite(arrays["reals"]).all():
        raise RcdnError(f"{name}: 'reals' must be finite; {FIX}")
    return CellNetwork(arrays["reals"], arrays["whole"])
