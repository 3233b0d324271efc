"""Files that are nearly valid: a good one with a few changes, at the level of bytes, of words, or of its values."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Sequence
from typing import Any

from tests.fuzz.source import Source

_WORD = re.compile(r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?|\w+|\s+|.", re.DOTALL)
_ODD_WORDS = (
    "0", "-1", "1e308", "-1e308", "1e400", "nan", "NaN", ".nan", "inf", ".inf",
    "-5", "2147483648", "9223372036854775808", "1" + "0" * 400, "1e-300", "null",
    "~", "true", '""', '"a"', "[]", "{}", "[[]]", "- ", ":", ",", "\n", "\t", "#", "%", "!!binary x", "&a", "*a", "<<",
    "\0", "\ufeff", "é", "[" * 60, "'", "=",
)  # fmt: skip


def changed_bytes(source: Source, good: bytes, most: int = 4) -> bytes:
    """`good` with up to `most` changes: bytes set, bits turned, parts removed, doubled or moved,
    numbers of four bytes replaced, an end cut off."""
    data = bytearray(good)
    for _ in range(1 + source.below(most)):
        kind, at = source.byte() % 8, source.below(len(data) + 1)
        size = 1 + source.below(16 if source.byte() % 4 else 600)
        if kind == 0:
            data[at : at + 1] = bytes([source.byte()])
        elif kind == 1 and at < len(data):
            data[at] ^= 1 << source.byte() % 8
        elif kind == 2:
            del data[at : at + size]
        elif kind == 3:
            data[at:at] = data[at : at + size]
        elif kind == 4:
            part = data[at : at + size]
            del data[at : at + size]
            to = source.below(len(data) + 1)
            data[to:to] = part
        elif kind == 5:
            odd = source.choice((0, 1, 0x7FFFFFFF, 0xFFFFFFFF, 0x80000000, 0xFFFF, 30_000, 100_000, len(good)))
            data[at : at + 4] = odd.to_bytes(4, "big" if source.byte() % 2 else "little")
        elif kind == 6:
            data[at : at + size] = bytes(source.byte() for _ in range(min(size, 16)))
        elif source.chance(2):
            del data[at:]
    return bytes(data)


def changed_text(source: Source, good: str, others: Sequence[str] = ()) -> bytes:
    """`good` with a few words replaced, left out, doubled or swapped, or with its bytes changed;
    sometimes spliced with another file."""
    if source.chance(8):
        return changed_bytes(source, good.encode())
    words = _WORD.findall(good)
    if others and source.chance(8):
        cut = source.below(len(words) + 1)
        rest = _WORD.findall(source.choice(others))
        words = words[:cut] + rest[source.below(len(rest) + 1) :]
    for _ in range(1 + source.below(4)):
        if not words:
            break
        at, kind = source.below(len(words)), source.byte() % 6
        if kind < 3:
            words[at] = source.choice(_ODD_WORDS) if source.byte() % 4 else repr(source.real())
        elif kind == 3:
            del words[at : at + 1 + source.below(12)]
        elif kind == 4:
            words[at:at] = words[at : at + 1 + source.below(40)]
        else:
            other = source.below(len(words))
            words[at], words[other] = words[other], words[at]
    return "".join(words).encode("utf-8", "surrogatepass")


def changed_tree(source: Source, root: Any, most: int = 3) -> Any:
    """Nested lists and objects, changed in place: up to `most` values replaced, left out, doubled,
    or put at another place."""
    tree = [root]
    for _ in range(1 + source.below(most)):
        owner, key = _place(source, tree)
        kind = source.byte() % 8
        if kind < 4:
            owner[key] = source.value()
        elif kind == 4 and owner is not tree:
            del owner[key]
        elif kind == 5 and isinstance(owner, list):
            owner.insert(key, copy.deepcopy(owner[key]))
        elif kind == 6:
            from_owner, from_key = _place(source, tree)
            owner[key] = copy.deepcopy(from_owner[from_key])
        elif isinstance(owner, dict):
            owner["more"] = source.value()
    return tree[0]


def _place(source: Source, tree: list[Any]) -> tuple[Any, Any]:
    """A random value of a tree: what holds it, and its key."""
    owner, key = tree, 0
    while isinstance(owner[key], list | dict) and len(owner[key]) and source.byte() % 6:
        owner = owner[key]
        keys = list(owner) if isinstance(owner, dict) else range(len(owner))
        key = source.choice(keys)  # type: ignore[arg-type]
    return owner, key


def changed_json(source: Source, good: str) -> bytes:
    """A JSON file with changed values, or as `changed_text`."""
    if source.chance(3):
        return changed_text(source, good)
    tree = changed_tree(source, json.loads(good))
    try:
        return json.dumps(tree).encode()
    except (ValueError, RecursionError):  # integers of too many digits for Python to write
        return b"1" + b"0" * 5000
