"""Bags as ROS writes them, made by the package rosbags: images of a bending tube, its force and its drives."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from ..short_run import BIAS, draw_image, push  # type: ignore[import-not-found]

START_S = 1_800_000_000
DELAY_NS = 30_000_000
"""How much later than it was stamped a message is received."""


@dataclass(frozen=True)
class Stamped:
    """A message of a topic, sent at ``time_ns``; ``stamped``: whether its header holds this; ``header_ns``: instead."""

    time_ns: int
    topic: str
    kind: str
    fields: Mapping[str, Any]
    stamped: bool = True
    header_ns: int | None = None


def image(time_s: float, topic: str = "/camera/image_raw/compressed", encoding: str = "", **more: Any) -> Stamped:
    """A frame of the short run; ``encoding``: of a raw image."""
    grey = draw_image(float(push(np.array(time_s))))
    time_ns = round((START_S + time_s) * 1e9)
    if not encoding:
        data = np.frombuffer(cv2.imencode(".png", grey)[1].tobytes(), np.uint8)
        return Stamped(time_ns, topic, "sensor_msgs/msg/CompressedImage", {"format": "png", "data": data}, **more)
    pixels = {
        "mono8": lambda: grey,
        "bgr8": lambda: np.stack([grey, grey, grey // 2], axis=2),
        "rgb8": lambda: np.stack([grey // 2, grey, grey], axis=2),
        "mono16": lambda: grey.astype("<u2") * 16,
    }[encoding]()
    height, width = grey.shape
    step = pixels.nbytes // height + 8  # rows may be padded
    rows = np.zeros((height, step), np.uint8)
    rows[:, :-8] = pixels.reshape(height, -1).view(np.uint8)
    fields = {"height": height, "width": width, "encoding": encoding, "is_bigendian": 0, "step": step}
    return Stamped(time_ns, topic, "sensor_msgs/msg/Image", {**fields, "data": rows.ravel()}, **more)


def wrench(time_s: float, topic: str = "/ft/wrench", **more: Any) -> Stamped:
    """The force of the short run."""
    force = [*(push(np.array(time_s)) * np.array([0.05, -0.2]) + BIAS), 0.0]
    fields = {"wrench": {"force": force, "torque": [0.0, 0.0, 0.0]}}
    return Stamped(round((START_S + time_s) * 1e9), topic, "geometry_msgs/msg/WrenchStamped", fields, **more)


def joints(time_s: float, names: Sequence[str], values: Sequence[float], topic: str = "/joint_states") -> Stamped:
    fields = {"name": list(names), "position": np.array(values), "velocity": np.empty(0), "effort": np.empty(0)}
    return Stamped(round((START_S + time_s) * 1e9), topic, "sensor_msgs/msg/JointState", fields)


def number(time_s: float, topic: str, value: float) -> Stamped:
    return Stamped(round((START_S + time_s) * 1e9), topic, "std_msgs/msg/Float64", {"data": value}, stamped=False)


def run_messages(seconds: float = 8.0, **more: Any) -> list[Stamped]:
    """Images at 24 Hz, forces at 250 Hz, the knob at 10 Hz as a joint in radians."""
    made = [image(k / 24, **more) for k in range(round(24 * seconds))]
    made += [wrench(k / 250, **more) for k in range(round(250 * seconds))]
    made += [joints(k / 10, ["knob_joint"], [np.radians(10.0)]) for k in range(round(10 * seconds))]
    return made


def _message(store: Any, ros1: bool, message: Stamped, sequence: int) -> Any:
    types = store.types
    fields = dict(message.fields)
    if message.kind.endswith("WrenchStamped"):
        vector, torque = (types["geometry_msgs/msg/Vector3"](*fields["wrench"][key]) for key in ("force", "torque"))
        fields = {"wrench": types["geometry_msgs/msg/Wrench"](vector, torque)}
    if message.kind != "std_msgs/msg/Float64":
        own_ns = message.time_ns if message.stamped else 0
        stamp = divmod(own_ns if message.header_ns is None else message.header_ns, 10**9)
        header = {"stamp": types["builtin_interfaces/msg/Time"](*stamp), "frame_id": ""}
        if ros1:
            header["seq"] = sequence
        fields["header"] = types["std_msgs/msg/Header"](**header)
    return types[message.kind](**fields)


def write_bag(folder: Path, kind: str, sent: Sequence[Stamped]) -> Path:
    """``kind``: "bag" (ROS 1), "db3", "mcap" or "folder"."""
    rosbag1, rosbag2 = (pytest.importorskip(f"rosbags.rosbag{version}") for version in (1, 2))
    from rosbags.typesys import Stores, get_typestore

    ros1 = kind == "bag"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    serialize: Callable[[Any, str], Any] = store.serialize_ros1 if ros1 else store.serialize_cdr
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / ("run.bag" if ros1 else "run")
    plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
    writer = rosbag1.Writer(path) if ros1 else rosbag2.Writer(path, version=9, storage_plugin=plugin)
    with writer:
        channels: dict[str, Any] = {}
        for sequence, each in enumerate(sorted(sent, key=lambda each: each.time_ns)):
            if each.topic not in channels:
                channels[each.topic] = writer.add_connection(each.topic, each.kind, typestore=store)
            raw = serialize(_message(store, ros1, each, sequence), each.kind)
            writer.write(channels[each.topic], each.time_ns + DELAY_NS, raw)
    return path if ros1 or kind == "folder" else next(path.glob(f"*.{kind}"))
