"""A ROS 2 node: boards in the pictures of a camera, and where they stand.

    python3 rcdn_node.py --ros-args -r image:=/camera/image_raw -p camera:=camera_info.yaml -p spacing:=0.025

Subscribes to `image` (sensor_msgs/Image: mono8, mono16, bgr8, rgb8, bgra8, rgba8). Publishes `corners`
(sensor_msgs/PointCloud: x, y, px; channels board, i, j, sigma) and, with a camera, `pose`
(geometry_msgs/PoseWithCovarianceStamped) of the largest board, from board to camera coordinates. A board seen in part
may turn up under other labels in the next picture, and so may a pose: name its `size` to have whole ones only.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import rcdn

CHANNELS = {"mono8": 1, "8UC1": 1, "mono16": 1, "16UC1": 1, "bgr8": 3, "8UC3": 3, "rgb8": 3, "bgra8": 4, "rgba8": 4}


def picture_of(message: Any) -> np.ndarray:
    """(H, W) or (H, W, 3 or 4) BGR[A] of a sensor_msgs/Image, without cv_bridge.
    Raises RcdnError for other encodings."""
    if message.encoding not in CHANNELS:
        raise rcdn.RcdnError(f"the encoding must be one of {', '.join(CHANNELS)}, not {message.encoding!r}")
    channels = CHANNELS[message.encoding]
    kind = np.dtype(np.uint16 if "16" in message.encoding else np.uint8)
    kind = kind.newbyteorder(">" if message.is_bigendian else "<")
    rows = np.frombuffer(bytes(message.data), np.uint8).reshape(message.height, message.step)  # rows may be padded
    rows = np.ascontiguousarray(rows[:, : message.width * channels * kind.itemsize])
    picture = rows.view(kind).astype(kind.newbyteorder("=")).reshape(message.height, message.width, channels)
    if message.encoding.startswith("rgb"):
        picture = picture[..., [2, 1, 0, 3][:channels]]
    return np.ascontiguousarray(picture[..., 0] if channels == 1 else picture)


def quaternion(rotation: np.ndarray) -> tuple[float, float, float, float]:
    """(x, y, z, w) of a rotation matrix (3, 3), w ≥ 0."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rotation).as_quat(canonical=True)
    return float(x), float(y), float(z), float(w)


def ros_covariance(pose: Any) -> list[float]:
    """36 numbers: of the board's origin, m, then of a turn around it, rad, in camera axes.

    rcdn's `cov` is of a motion of space, (turn around the camera, translation):
    the origin t moves by turn × t + translation.
    """
    x, y, z = pose.t
    slopes = np.zeros((6, 6))
    slopes[:3, :3] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    slopes[:3, 3:] = slopes[3:, :3] = np.eye(3)
    return [float(v) for v in (slopes @ pose.cov @ slopes.T).ravel()]


def main() -> None:
    """Run the node until it is stopped."""
    import rclpy
    from geometry_msgs.msg import Point32, PoseWithCovarianceStamped
    from rclpy.node import Node
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import ChannelFloat32, Image, PointCloud

    rclpy.init()
    node = Node("rcdn")
    file = node.declare_parameter("camera", "").value
    spacing = node.declare_parameter("spacing", 0.025).value  # m
    size = tuple(node.declare_parameter("size", [0, 0]).value)  # inner corners, (0, 0): any
    camera = rcdn.Camera.load(file) if file else None
    detector = rcdn.Detector(rcdn.DetectorConfig(threads=2))
    corners_out = node.create_publisher(PointCloud, "corners", 10)
    pose_out = node.create_publisher(PoseWithCovarianceStamped, "pose", 10)

    def publish_corners(header: Any, boards: list[rcdn.Board]) -> None:
        cloud = PointCloud(header=header)
        rows = [row for k, b in enumerate(boards) for row in np.c_[b.xy, np.full(len(b), k), b.ij, b.sigma].tolist()]
        cloud.points = [Point32(x=row[0], y=row[1]) for row in rows]
        for at, name in enumerate(("board", "i", "j", "sigma"), start=2):
            cloud.channels.append(ChannelFloat32(name=name, values=[row[at] for row in rows]))
        corners_out.publish(cloud)

    def publish_pose(header: Any, board: rcdn.Board, camera: rcdn.Camera) -> None:
        pose = rcdn.estimate_pose(board, camera, spacing=spacing)
        out = PoseWithCovarianceStamped(header=header)
        at, turn = out.pose.pose.position, out.pose.pose.orientation
        at.x, at.y, at.z = (float(v) for v in pose.t)
        turn.x, turn.y, turn.z, turn.w = quaternion(pose.R)
        out.pose.covariance = ros_covariance(pose)
        pose_out.publish(out)

    def on_image(message: Any) -> None:
        try:
            boards = detector.boards(picture_of(message))
            boards = [b for b in boards if size == (0, 0) or (b.complete and size in (b.size, b.size[::-1]))]
            publish_corners(message.header, boards)
            if camera is not None and boards:
                publish_pose(message.header, boards[0], camera)
        except rcdn.RcdnError as error:  # one bad picture stops nothing
            node.get_logger().warning(str(error), throttle_duration_sec=5.0)

    node.create_subscription(Image, "image", on_image, qos_profile_sensor_data)
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
