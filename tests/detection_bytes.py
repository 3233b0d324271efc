"""What the kernels of one library make of pictures, exactly: `python detection_bytes.py LIBRARY PICTURES.npz` prints
digests by name, JSON."""

import dataclasses
import hashlib
import importlib.util
import json
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent / "boards"))


def load_kernels(path):
    """Let `rcdn` take its kernels from the library at `path`."""
    spec = importlib.util.spec_from_file_location("rcdn._native", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    sys.modules["rcdn._native"] = module


def digest(value):
    """Of every bit of arrays, also those in lists, tuples and data classes."""
    if dataclasses.is_dataclass(value):
        value = [getattr(value, field.name) for field in dataclasses.fields(value)]
    if isinstance(value, list | tuple):
        value = "".join(digest(v) for v in value)
    whole = isinstance(value, np.ndarray) and value.dtype != object
    return hashlib.sha256(value.tobytes() if whole else repr(value).encode()).hexdigest()[:16]


def pictures():
    """Of an easy board, a blurred one in faint light, several, small squares, and triangles; of bytes and of floats."""
    from board_scene import board, scene

    from rcdn.synthetic import DELTILLE, random_scene, render

    several = (board(7, 5, 26, at=(-90, -50)), board(6, 4, 22, roll=-30, tilt=40, at=(110, 80)))
    wanted = {
        "easy": scene(noise=1.0),
        "blurred": scene(noise=4.0, tilt=50.0, roll=35.0),
        "several": scene(boards=several),
        "small": scene(9, 6, pitch=7.0),
        "deltille": random_scene(np.random.default_rng(3), DELTILLE),
    }
    shown = {name: render(one, samples=2) for name, one in wanted.items()}
    noise = np.random.default_rng(0).normal(0, 0.3, shown["several"].shape)
    return shown | {"float": np.clip(shown["several"] + noise, 0, 255).astype(np.float32)}


def main():
    load_kernels(sys.argv[1])
    from rcdn import Detector
    from rcdn.config import DetectorConfig

    detectors = {p: Detector(DetectorConfig(pattern=p)) for p in ("checker", "deltille")}
    out = {}
    for name, picture in np.load(sys.argv[2]).items():
        detector = detectors["deltille" if name == "deltille" else "checker"]
        found = detector.detect(picture)
        out[f"{name}: boards"] = [[len(b), digest(b)] for b in found.boards]
        out[f"{name}: corners"] = digest(found.corners)
        out[f"{name}: response"] = digest(detector.response(picture))
    print(json.dumps(out))


if __name__ == "__main__":
    main()
