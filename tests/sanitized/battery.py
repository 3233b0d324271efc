"""What runs under the sanitizers: every kernel with odd values, and whole detections of odd
pictures, on several threads."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

SIDES = (1, 2, 3, 4, 5, 7, 11, 16, 23, 33, 61, 95)
PARTS = {"detections": (("kernels", 4000),), "arrays": (("arrays", 120), ("sharpening", 60))}
"""part → fuzz targets and their inputs; kernels are called with what they were given in detections, which come first"""
BASELINE = {"arrays"}
"""parts in which kernels take no more than the baseline's instructions; in others, the most that the processor has"""
SEED = 27


def use(path: Path) -> None:
    """Let the library at `path` be rcdn's."""
    import rcdn

    spec = spec_from_file_location("rcdn._native", path)
    assert spec is not None
    assert spec.loader is not None
    sys.modules["rcdn._native"] = module = module_from_spec(spec)
    spec.loader.exec_module(module)
    rcdn._native = module  # type: ignore[attr-defined]


def pictures() -> Iterator[Any]:
    """Pictures (H, W) of every small shape: noise, one value, squares, boards, with codes, too,
    and their parts; both types."""
    import numpy as np
    from tests.fuzz import samples

    rng = np.random.default_rng(SEED)
    shapes = [(h, w) for k, h in enumerate(SIDES) for w in SIDES[k % 3 :: 3]]
    for height, width in [*shapes, (1, 200), (200, 1), (2, 150), (150, 3)]:
        board = samples.picture(5, 4, 9.0, (width + 9, height + 9))[4 : 4 + height, 3 : 3 + width]
        noise = rng.integers(0, 256, (height, width)).astype(np.uint8)
        kinds = (board, noise, np.full((height, width), 255, np.uint8))
        yield kinds[(height + width) % 3]
        yield np.ascontiguousarray(kinds[(height + width + 1) % 3], np.float32) * np.float32(0.999)
    whole = samples.picture(7, 5, 12.0, (140, 110))
    coded = samples.coded_picture()
    for image in (coded, coded[40:, 23:], whole, whole[7:, 11:], whole[:-30, :-41], whole.T, whole[::-1], 255 - whole):
        yield np.ascontiguousarray(image)
        yield np.ascontiguousarray(image, np.float32) / np.float32(255)


def detect_all() -> int:
    """Boards of squares and triangles, as `auto` and as `paper` look for them, on one thread and on three."""
    import rcdn

    settings = [{"threads": 3, "target": "auto"}, {"threads": 1, "pattern": "deltille"}]
    detectors = [rcdn.Detector(rcdn.DetectorConfig(**s)) for s in settings]
    detectors.append(rcdn.Detector(rcdn.DetectorConfig.paper(threads=3)))
    count = 0
    for image in pictures():
        count += 1
        for detector in detectors[: 3 if count % 4 == 0 else 1]:
            detector.detect(image)
    return count


def fuzz(name: str, inputs: int) -> None:
    """So many inputs of a fuzz target; what it raises is the fuzzing's business."""
    import warnings

    from tests.fuzz.engine import chosen_at_random
    from tests.fuzz.guard import Guard
    from tests.fuzz.targets import TARGETS

    guard = Guard(TARGETS[name])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for number in range(inputs):
            guard.run(chosen_at_random(SEED, name, number))


def main() -> None:
    """Run one of the PARTS, with the library that is named: argv is its path and the part."""
    use(Path(sys.argv[1]))
    began = time.monotonic()

    def report(what: str) -> None:
        print(f"{time.monotonic() - began:6.1f} s: {what}", flush=True)

    if sys.argv[2] == "detections":
        from tests.fuzz import kernels

        kernels.record()
        report(f"{detect_all()} pictures")
    for name, inputs in PARTS[sys.argv[2]]:
        fuzz(name, inputs)
        report(f"{inputs} inputs of {name}")


if __name__ == "__main__":
    main()
