"""Settings: there and back, and what is refused."""

import json

import pytest

from rcdn.config import Adaptive, Cluster, DetectorConfig, Fixed, MaxFraction, Nms, Refine, Sharpen, Std
from rcdn.errors import ConfigError

CONFIGS = [
    DetectorConfig(), DetectorConfig.auto(threads=3), DetectorConfig.paper(), DetectorConfig.paper(threshold=Std(1.7)),
    DetectorConfig(threshold=Fixed(0.2), nms=Nms(7, 0.3), cluster=Cluster(k=4), refine=Refine("peak", 3)),
    DetectorConfig(threshold=MaxFraction(), model="folder/some.onnx", border=0, seed=1, weak=0.5, min_corners=4),
    DetectorConfig(sharpen=Sharpen(geometry=False)), DetectorConfig(sharpen=None),
]  # fmt: skip


@pytest.mark.parametrize("config", CONFIGS)
def test_json_there_and_back(config):
    again = DetectorConfig.from_json(config.to_json())
    assert again == config
    assert again.to_json() == config.to_json()
    assert hash(again) == hash(config)


def test_presets():
    assert DetectorConfig.preset("auto") == DetectorConfig()
    paper = DetectorConfig.preset("paper", threads=2)
    assert paper == DetectorConfig.paper(threads=2)
    assert (paper.threshold, paper.nms, paper.cluster) == (Adaptive(0.5), Nms(9, 0.5), Cluster(10, 2, 30))
    assert (paper.refine, paper.seed, paper.weak) == (Refine("mixed", 2), 1, 1)
    assert (DetectorConfig().sharpen, paper.sharpen) == (Sharpen(True), None)
    with pytest.raises(ConfigError, match="'fast'"):
        DetectorConfig.preset("fast")


def changed(*path, to):
    plain = json.loads(DetectorConfig.paper().to_json())
    inner = plain
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = to
    return json.dumps(plain)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "not JSON"),
        ("3", "expected a DetectorConfig, not int"),
        ("{}", "unknown type None"),
        ('{"type": ["Nms"]}', "unknown type"),
        ('{"type": "Nms"}', "expected a DetectorConfig, not Nms"),
        (changed("thresold", to=1), "thresold"),
        (changed("nms", "side", to=3), "Nms has no setting .*side"),
        (changed("threshold", "type", to="Median"), "Median"),
        (changed("threshold", to=0.5), "DetectorConfig.threshold"),
        (changed("nms", to={"type": "Cluster"}), "DetectorConfig.nms"),
        (changed("model", to=None), "DetectorConfig.model"),
        (changed("sharpen", to=True), "DetectorConfig.sharpen"),
        (changed("nms", "box", to="9"), "Nms.box"),
        (changed("threads", to=True), "DetectorConfig.threads"),
    ],
)
def test_from_json_names_what_is_wrong(text, words):
    with pytest.raises(ConfigError, match=words):
        DetectorConfig.from_json(text)


@pytest.mark.parametrize(
    ("kind", "values", "words"),
    [
        (Nms, {"box": 4}, "Nms.box must be odd"),
        (Nms, {"box": -1}, "Nms.box"),
        (Nms, {"box": 5.0}, "Nms.box"),
        (Nms, {"overlap": 0.0}, "Nms.overlap"),
        (Nms, {"overlap": 1.0}, "Nms.overlap"),
        (Refine, {"method": "best"}, "Refine.method.*'best'"),
        (Refine, {"half": 0}, "Refine.half"),
        (Sharpen, {"geometry": 1}, "Sharpen.geometry"),
        (Cluster, {"k": 0}, "Cluster.k"),
        (Cluster, {"seed": -1}, "Cluster.seed"),
        (Fixed, {"value": float("nan")}, "Fixed.value"),
        (Adaptive, {"level": "0.5"}, "Adaptive.level"),
        (Std, {"factor": float("inf")}, "Std.factor"),
        (MaxFraction, {"fraction": 1.5}, "MaxFraction.fraction"),
        (DetectorConfig, {"weak": 0.0}, "DetectorConfig.weak"),
        (DetectorConfig, {"seed": 1.1}, "DetectorConfig.seed"),
        (DetectorConfig, {"border": -1}, "DetectorConfig.border"),
        (DetectorConfig, {"min_corners": 0}, "DetectorConfig.min_corners"),
        (DetectorConfig, {"threads": -1}, "DetectorConfig.threads"),
    ],
)
def test_bad_values_are_refused(kind, values, words):
    with pytest.raises(ConfigError, match=words):
        kind(**values)
