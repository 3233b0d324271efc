"""Good files made bad by a seed, for tests of readers: of values as JSON and TOML have them, of text, and of bytes."""

import copy
import json
import math
import re
import struct

NUMBERS = (
    0, -0.0, 1, -1, -5, 0.5, 7, 2**31, 2**63, -(2**63), 10**15, 10**400, -(10**400), 1e150, -1e150, 1e308, -1e308,
    1e-300, 5e-324, 1e20, 1e7, math.nan, math.inf, -math.inf,
)  # fmt: skip
OTHERS = (
    None, True, False, "", "x", "1e9", "nan", "\ud800", "a\nb\x1b[31m", "x" * 5000, [], {}, [[]], [None], {"x": 1},
)  # fmt: skip
TOKENS = (
    "0", "-5", "1e150", "1e308", "-1e308", "1e-300", "1e999", "-1e999", "nan", ".nan", ".inf", "null", "x", "''", "[]",
    "{}", "~", "9" * 30, "9" * 5000, "0x" + "f" * 5000, "1e7", "0.5", "true", "[[[[1]]]]", "&a [1]", "*a", "2001-01-01",
    "1+2j", "b'x'", "'\\ud800'",
)  # fmt: skip
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def deep(levels=3000):
    """A list in a list in a list …"""
    value = []
    for _ in range(levels):
        value = [value]
    return value


def places(value, path=()):
    """The path of every value in `value`, itself included."""
    yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, (list, tuple)) else ()
    for key, inner in items:
        yield from places(inner, (*path, key))


def mutated(value, rng, times=None):
    """A copy of a JSON-like value with one to three changes drawn by `rng` (random.Random)."""
    value = copy.deepcopy(value)
    for _ in range(times or rng.choice((1, 1, 2, 3))):
        value = _changed(value, rng)
    return value


def _changed(value, rng):
    known = list(places(value))
    by_depth = {}
    for path in known:  # deep lists of numbers are most of a file, but not most of its fields
        by_depth.setdefault(tuple(k for k in path if isinstance(k, str)), []).append(path)
    path = rng.choice(by_depth[rng.choice(list(by_depth))])
    old = value
    for key in path:
        old = old[key]
    if not path:
        return copy.deepcopy(rng.choice((*OTHERS, 3)))
    parent = value
    for key in path[:-1]:
        parent = parent[key]
    kind = rng.randrange(8)
    if kind == 0 and isinstance(parent, (dict, list)):
        del parent[path[-1]]
    elif kind == 1 and isinstance(old, list) and old:
        old.append(copy.deepcopy(rng.choice(old)))
    elif kind == 2 and isinstance(parent, list):
        parent[path[-1]] = copy.deepcopy(rng.choice(parent))
    elif kind == 3:
        parent[path[-1]] = [old]
    elif kind == 4 and isinstance(old, (int, float)) and not isinstance(old, bool):
        parent[path[-1]] = old * 10.0 ** rng.randrange(-300, 300) if abs(old) < 1e8 else -old
    elif kind == 5:
        parent[path[-1]] = copy.deepcopy(rng.choice(OTHERS))
    else:
        parent[path[-1]] = rng.choice(NUMBERS)
    return value


def as_json(value, rng=None):
    """JSON text of a value, NaN and infinities as Python writes them; now and then damaged as text, too."""
    text = json.dumps(value)
    return damaged_text(text, rng) if rng is not None and rng.random() < 0.1 else text


def damaged_text(text, rng):
    """`text` with a number, or anything, replaced."""
    found = list(NUMBER.finditer(text))
    if found and rng.random() < 0.7:
        spot = rng.choice(found)
        return text[: spot.start()] + rng.choice(TOKENS) + text[spot.end() :]
    start = rng.randrange(len(text) + 1)
    end = min(len(text), start + rng.choice((0, 1, 3, 20)))
    return text[:start] + rng.choice((*TOKENS, "", "\n", "[" * 2000, "\x00", "\ufeff")) + text[end:]


def damaged_bytes(data, rng):
    """`data` cut short, or with bytes flipped, put in, taken out or set to what is large as a length."""
    data = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 4))):
        at = rng.randrange(len(data) + 1)
        kind = rng.randrange(5)
        if kind == 0:
            del data[at:]
        elif kind == 1:
            data[at : at + 1] = bytes([rng.randrange(256)])
        elif kind == 2:
            data[at : at + rng.randrange(1, 9)] = rng.choice(
                (b"", b"\xff" * 9 + b"\x7f", b"\x00", struct.pack("<f", math.nan))
            )
        elif kind == 3:
            del data[at : at + rng.randrange(1, 40)]
        else:
            data[at:at] = bytes(data[at : at + rng.randrange(1, 40)])
    return bytes(data)
