"""examples/rcdn_node.py without ROS: its conversions, and the whole node on stand-ins for the few
classes that it uses."""

import importlib.util
import sys
from types import ModuleType, SimpleNamespace

import cv2
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from tests.doc_blocks import ROOT

import rcdn
from rcdn.synthetic import camera_view, render

SQUARE = 0.025


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("rcdn_node", ROOT / "examples/rcdn_node.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def message(picture, encoding, padding=0, big=False):
    """A sensor_msgs/Image of an array in the order of the encoding."""
    rows = picture.reshape(len(picture), -1)
    rows = rows.astype(rows.dtype.newbyteorder(">" if big else "<")).view(np.uint8)
    data = np.pad(rows, ((0, 0), (0, padding)), constant_values=7)
    height, width = picture.shape[:2]
    fields = {"height": height, "width": width, "encoding": encoding, "is_bigendian": int(big)}
    return SimpleNamespace(**fields, step=data.shape[1], data=data.tobytes(), header="header")


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize("big", [False, True])
def test_pictures_come_out_of_messages_as_they_went_in(example, padding, big):
    rng = np.random.default_rng(0)
    grey, deep = rng.integers(0, 255, (4, 6), np.uint8), rng.integers(0, 65535, (4, 6), np.uint16)
    colour = rng.integers(0, 255, (4, 6, 4), np.uint8)
    for encoding, sent, wanted in [
        ("mono8", grey, grey),
        ("mono16", deep, deep),
        ("bgr8", colour[..., :3], colour[..., :3]),
        ("rgb8", colour[..., :3], colour[..., 2::-1]),
        ("rgba8", colour, colour[..., [2, 1, 0, 3]]),
    ]:
        assert np.array_equal(example.picture_of(message(sent, encoding, padding, big)), wanted)


def test_other_encodings_are_refused(example):
    with pytest.raises(rcdn.RcdnError, match="encoding"):
        example.picture_of(message(np.zeros((2, 2), np.uint8), "bayer_rggb8"))


def test_covariances_are_of_the_origin_and_a_turn_around_it(example):
    rng = np.random.default_rng(1)
    half = rng.normal(size=(6, 6)) * 1e-4
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix(), [0.1, -0.2, 0.7]
    pose = SimpleNamespace(t=T[:3, 3], cov=half @ half.T)
    moved = np.zeros((6, 6))
    for k, column in enumerate(half.T):
        motion = np.zeros((4, 4))
        motion[:3, :3], motion[:3, 3] = np.cross(np.eye(3), column[:3]), column[3:]
        other = expm(motion) @ T
        moved[:3, k] = other[:3, 3] - T[:3, 3]
        moved[3:, k] = Rotation.from_matrix(other[:3, :3] @ T[:3, :3].T).as_rotvec()
    assert np.reshape(example.ros_covariance(pose), (6, 6)) == pytest.approx(moved @ moved.T, rel=5e-3, abs=1e-10)


class Anything(SimpleNamespace):
    """A message: any fields, and those of a pose."""

    def __init__(self, **fields):
        super().__init__(**{"channels": [], **fields})
        if "header" in fields and "points" not in fields:
            self.pose = SimpleNamespace(
                pose=SimpleNamespace(position=SimpleNamespace(), orientation=SimpleNamespace()), covariance=None
            )


class Node:
    """What rclpy's Node does, as far as the example goes: one message arrives for each that is put into `arriving`."""

    parameters, arriving, published, warnings = {}, [], {}, []

    def __init__(self, name):
        assert name == "rcdn"

    def declare_parameter(self, name, default):
        return SimpleNamespace(value=self.parameters.get(name, default))

    def create_publisher(self, kind, topic, depth):
        self.published[topic] = []
        return SimpleNamespace(publish=self.published[topic].append)

    def create_subscription(self, kind, topic, callback, profile):
        assert topic == "image"
        Node.callback = staticmethod(callback)

    def get_logger(self):
        return SimpleNamespace(warning=lambda text, **_: self.warnings.append(text))

    def destroy_node(self):
        pass


def stand_ins():
    """Modules of ROS by name."""

    def spin(node):
        for each in Node.arriving:
            Node.callback(each)

    made = {name: ModuleType(name) for name in ("rclpy", "rclpy.node", "rclpy.qos", "geometry_msgs", "sensor_msgs")}
    made |= {name: ModuleType(name) for name in ("geometry_msgs.msg", "sensor_msgs.msg")}
    vars(made["rclpy"]).update(init=lambda: None, spin=spin, try_shutdown=lambda: None)
    made["rclpy.node"].Node, made["rclpy.qos"].qos_profile_sensor_data = Node, None
    vars(made["geometry_msgs.msg"]).update(Point32=Anything, PoseWithCovarianceStamped=Anything)
    vars(made["sensor_msgs.msg"]).update(ChannelFloat32=Anything, Image=Anything, PointCloud=Anything)
    return made


def test_the_node_publishes_corners_and_the_pose(example, monkeypatch, tmp_path):
    scene = camera_view(1, 1)
    scene.camera.save(tmp_path / "camera_info.yaml")
    picture = cv2.cvtColor(render(scene), cv2.COLOR_GRAY2BGR)
    for name, module in stand_ins().items():
        monkeypatch.setitem(sys.modules, name, module)
    parameters = {"camera": str(tmp_path / "camera_info.yaml"), "spacing": SQUARE, "size": [6, 9]}
    bad = message(picture[..., 0], "mono8")
    bad.encoding = "odd"
    arriving = [bad, message(np.zeros((64, 64), np.uint8), "mono8"), message(picture, "bgr8", padding=3)]
    for name, value in {"parameters": parameters, "arriving": arriving, "published": {}, "warnings": []}.items():
        monkeypatch.setattr(Node, name, value)
    example.main()
    assert len(Node.warnings) == 1
    none, found = Node.published["corners"]
    assert none.points == []
    (board,) = rcdn.Detector().boards(picture)
    assert np.array_equal([(p.x, p.y) for p in found.points], board.xy)
    assert [channel.name for channel in found.channels] == ["board", "i", "j", "sigma"]
    (out,) = Node.published["pose"]
    place, turn = out.pose.pose.position, out.pose.pose.orientation
    spec = scene.boards[0]
    turned = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    centre = np.array([place.x, place.y, place.z]) + turned @ [SQUARE * 4, SQUARE * 2.5, 0]
    true = cv2.Rodrigues(np.array(spec.rvec))[0] @ [4, 2.5, 0] + spec.tvec
    assert centre == pytest.approx(SQUARE * true, abs=1e-4)
    assert len(out.pose.covariance) == 36
