"""`python -m tests.replay.record PICTURES.npz CALLS [KERNEL …]`: every kernel's calls in detections, or those of some,
with what they gave, for `replay.c`."""

from __future__ import annotations

import struct
import sys
from collections import Counter
from pathlib import Path
from typing import Any, BinaryIO

MOST_CALLS = 60
"""calls of one kernel"""


def written(file: BinaryIO, specs: Any, given: Any) -> list[Any]:
    """Write arguments down; the arrays among them that a call writes to."""
    outputs = []
    for (_, what, _, _, is_output, inner), value in zip(specs, given, strict=True):
        if what == "group":
            outputs += written(file, inner, value)
        elif what == "int":
            file.write(struct.pack("<q", int(value)))
        elif what == "real":
            file.write(struct.pack("<d", float(value)))
        else:
            file.write(struct.pack(f"<{value.ndim + 1}q", *value.shape, value.itemsize))
            file.write(value.tobytes())
            outputs += [value] if is_output else []
    return outputs


def recorded(name: str, kernel: Any, specs: Any, file: BinaryIO, made: Counter[str]) -> Any:
    """The kernel, whose first calls are written down."""

    def call(*given: Any) -> Any:
        if made[name] >= MOST_CALLS:
            return kernel(*given)
        made[name] += 1
        file.write(name.encode().ljust(64, b"\0"))
        outputs = written(file, specs, given)
        result = kernel(*given)
        file.write(struct.pack("<q", result))
        for array in outputs:
            file.write(array.tobytes())
        return result

    return call


def record(pictures: Path, into: Path, *only: str) -> Counter[str]:
    """Detect boards in the pictures; how many calls of each kernel (of those named, if any is) were written down. For a
    process of its own: kernels stay replaced."""
    import rcdn._native as native

    made: Counter[str] = Counter()
    with into.open("wb") as file:
        for name, kernel in native.kernels.items():
            if not only or name in only:
                native.kernels[name] = recorded(name, kernel, native.arguments[name], file, made)
        import numpy as np

        from rcdn import Detector, DetectorConfig

        for picture in np.load(pictures).values():
            Detector(DetectorConfig(threads=1)).detect(picture)
    return made


if __name__ == "__main__":
    print(dict(record(Path(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:])))
