"""Reads a bag: its images as a source, its force log, and its logs of drives and stage."""

import heapq
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..._system.contexts import ClosedAtExit
from ...errors import FileFormatError, InputError, TimeError
from ...types import FORCE_RANGE, Actuation, BagInfo, Event, FloatArray, Frame, IntArray, SessionInfo, actuation_range
from .._container import is_foreign
from .._force_log import DriveLog, ForceLog
from .._images import StreamDepth
from ..tables import ACTUATION_UNITS, MAX_PAUSE_S
from ._image_messages import IMAGE_KINDS, image_of, png_of_16_bits
from ._messages import BagMessage, Topic, listed_topics, messages, only_topic, topics_of

WRENCH_KINDS = ("WrenchStamped", "Wrench")
NUMBER_KINDS = ("Float64", "Float32", "Float64Stamped", "Float32Stamped")
REORDERED_FRAMES = 8
"""Largest number of images that may arrive before one with an earlier stamp."""

_PER_SI_UNIT = {"deg": math.degrees(1.0), "rad": 1.0, "m": 1.0, "mm": 1e3, "um": 1e6}
"""Number of each unit in a radian or metre: a JointState holds these, and the name of a drive states its unit."""


def is_bag(path: Path) -> bool:
    """Returns whether ``path`` is a ROS bag (.bag, .db3, a folder with metadata.yaml) or a foreign MCAP file."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file()
    return path.suffix in (".bag", ".db3") or (path.suffix == ".mcap" and path.is_file() and is_foreign(path))


@dataclass(slots=True)
class Bag(ClosedAtExit):
    """A `Source` of the images of a bag, with its forces and its readings of drives.

    Attributes:
        path: the bag.
        session_info: metadata of the session.
        views: view -> topic of its images.
        force: readings of the force sensor; None without a topic.
        joints: readings of the catheter's drives; None without a topic.
        stage: readings of the stage; None without a topic.
        remarks: the chosen topics and the assumptions, in sentences.
        received: topics whose messages are placed at the times at which they were received.
        numbered: whether the stamps only count the images.
    """

    path: Path
    session_info: SessionInfo
    views: Mapping[str, Topic]
    force: ForceLog | None = None
    joints: DriveLog | None = None
    stage: DriveLog | None = None
    remarks: list[str] = field(default_factory=list[str])
    received: frozenset[str] = frozenset()
    numbered: bool = False

    @property
    def frame_count(self) -> int:
        """Number of images in the bag."""
        return sum(topic.count for topic in self.views.values())

    def lacks(self, names: Iterable[str]) -> list[str]:
        """Returns those of the actuation's ``names`` that have no reading."""
        there = {*self.session_info.actuation.constant, *(self.joints.values if self.joints else ())}
        return [name for name in names if name not in there]

    def readings(self, name: str) -> FloatArray:
        """Returns the (n,) readings of the drive ``name``."""
        if self.joints and name in self.joints.values:
            values = self.joints.values[name]
            return values[np.isfinite(values)]
        constant = self.session_info.actuation.constant.get(name)
        return np.empty(0) if constant is None else np.array([constant])

    def __iter__(self) -> Iterator[Event]:
        """Yields the images, and before each the readings of the catheter's drives since the image before it."""
        stamps = np.empty(0, np.int64) if self.joints is None else self.joints.stamp_ns
        constant = dict(self.session_info.actuation.constant)
        row = 0
        for number, frame in enumerate(self.frames()):
            if number == 0 and constant:
                yield Actuation(frame.stamp_ns, constant)
            while self.joints is not None and row < len(stamps) and stamps[row] <= frame.stamp_ns:
                readings = {name: float(values[row]) for name, values in self.joints.values.items()}
                present = {name: value for name, value in readings.items() if not math.isnan(value)}
                yield Actuation(int(stamps[row]), present)
                row += 1
            yield frame

    def frames(self) -> Iterator[Frame]:
        """Yields the images in the order of their stamps. Raises TimeError where they are far from this order.

        Messages may be slightly out of order in the bag. `REORDERED_FRAMES` of them wait in a heap, and the earliest
        one leaves it when another comes.
        """
        names = {topic.name: view for view, topic in self.views.items()}
        depths = {name: StreamDepth(_DeepImages(self.path, name)) for name in names}
        waiting: list[tuple[int, int, str, Any]] = []  # stamp, place in the bag, topic, message
        last: dict[str, int] = {}  # topic -> stamp of its last image

        def pop_all_but(waiting_count: int) -> Iterator[Frame]:
            while len(waiting) > waiting_count:
                stamp, _, name, content = heapq.heappop(waiting)
                if stamp > last.get(name, -1):
                    last[name] = stamp
                    where = f"{self.path}, {name} at {stamp * 1e-9:.3f} s"
                    yield Frame(stamp, image_of(content, where, depths[name]), names[name])
                elif name not in self.received:  # two images that were received at the same time count as one
                    raise TimeError(
                        f"{self.path}, topic {name}: the image at {stamp * 1e-9:.6f} s is not after the one before it; "
                        "to use the times at which the images were received instead of their own stamps, state in "
                        f'bench.toml: bag.receive_times = ["{name}"]'
                    )

        for order, (name, message) in enumerate(messages(self.path, list(names))):
            stamp = _stamp(message, name in self.received)
            if stamp is not None:
                heapq.heappush(waiting, (stamp, order, name, message.content))
                yield from pop_all_but(REORDERED_FRAMES)
        yield from pop_all_but(0)


class _DeepImages:
    """Yields the images of 16 bits of one topic, encoded: all of them determine how many bits the camera uses."""

    def __init__(self, path: Path, topic: str) -> None:
        self._path, self._topic = path, topic

    def __call__(self) -> Iterator[bytes]:
        for name, message in messages(self._path, [self._topic]):
            content = message.content
            if hasattr(content, "encoding"):
                yield png_of_16_bits(content, f"{self._path}, {name}")
            else:
                yield np.asarray(content.data, np.uint8).tobytes()


def _stamp(message: BagMessage, received: bool) -> int | None:
    """Returns the stamp of a message; None for a message without one in a topic whose other messages have one."""
    if received:
        return message.received_ns
    return message.header_ns or None


def open_bag(path: Path, info: SessionInfo, *, images: bool = True) -> Bag:
    """Chooses the topics of a bag, and reads them except the images.

    Args:
        path: a ROS 1 bag (.bag), a ROS 2 bag (.db3, .mcap or their folder).
        info: metadata of the session; ``bag`` states the topics.
        images: whether the images are wanted, too.

    Returns:
        The bag with its forces and drives; its remarks state the choices.

    Raises:
        FileFormatError: it cannot be read, or has no images.
        InputError: topics are not clear; the message has the line of ``bench.toml`` that chooses.
        TimeError: messages have no stamps of their own.
        MissingExtraError: rosbags is not installed.
    """
    if not path.exists():
        raise FileFormatError(f"{path}: there is no such file or folder")
    topics, stated, remarks = topics_of(path), info.bag, list[str]()
    views = _views(path, topics, stated, remarks) if images else {}
    force = _named(path, topics, stated.force, "bag.force", WRENCH_KINDS)
    if stated.force is None:
        force = only_topic(path, topics, WRENCH_KINDS, "forces", 'bag.force = "{}"')
        if force:
            remarks.append(f"the force is taken from its only topic of forces, {force.name}")
    drives, stage = _drive_topics(path, topics, stated, remarks)
    used = [*(topic.name for topic in views.values()), *([force.name] if force else []), *drives, *stage]
    received = _without_stamps(path, topics, used, stated, remarks)
    bag = Bag(path, SessionInfo(path.stem).updated(info), views, remarks=remarks, received=received)
    columns = _Columns(path, received, stated.names, {topic.name: topic.kind for topic in topics.values()})
    for name, message in messages(path, [*drives, *stage, *([force.name] if force else [])]):
        columns.add(name, message)
    if force:
        bag.force = columns.force(force.name)
    bag.joints = columns.drives(drives, remarks) if drives else None
    bag.stage = columns.drives(stage, remarks) if stage else None
    return bag


def _views(path: Path, topics: Mapping[str, Topic], stated: BagInfo, remarks: list[str]) -> dict[str, Topic]:
    """Returns view -> topic of its images: the stated ones, else the only topic of images, with a remark.

    Raises FileFormatError where there is no topic of images, InputError where there are several or a stated one is not.
    """
    if stated.views:
        chosen = {v: _named(path, topics, name, f"bag.views.{v}", IMAGE_KINDS) for v, name in stated.views.items()}
        return {view: topic for view, topic in chosen.items() if topic is not None}
    only = only_topic(path, topics, IMAGE_KINDS, "images", 'bag.views = {{ camera = "{}" }}')
    if only is None:
        raise FileFormatError(
            f"{path}: has no topic of images (Image or CompressedImage); it has "
            f"{listed_topics(list(topics.values()))}; if a video was recorded beside it, name both: `tipforce import "
            f"video.mp4 {path.name}`"
        )
    remarks.append(f"the images are taken from its only topic of images, {only.name}")
    return {"camera": only}


def _named(path: Path, topics: Mapping[str, Topic], name: str | None, key: str, kinds: Sequence[str]) -> Topic | None:
    """Returns the topic that ``bench.toml`` states. Raises InputError where it is missing or of another type."""
    if name is None:
        return None
    topic = topics.get(name) or topics.get("/" + name.strip("/"))
    if topic is None or topic.kind not in kinds:
        fault = "has no topic" if topic is None else f"has messages of the type {topic.kind} in the topic"
        fitting = [topic for topic in topics.values() if topic.kind in kinds]
        choice = f"those of the types {' or '.join(kinds)} are {listed_topics(fitting) or 'none'}"
        raise InputError(f"{path}: {fault} {name!r}, as {key} in bench.toml states; {choice}")
    return topic


def _drive_topics(
    path: Path, topics: Mapping[str, Topic], stated: BagInfo, remarks: list[str]
) -> tuple[list[str], list[str]]:
    """Returns the names of the topics of the catheter's drives, and of those of the stage.

    Where ``bench.toml`` states none, the name of a topic of numbers decides: a length ("x_mm") is the stage, another
    NAME_UNIT a drive. The only topic of joints belongs to the drives. The choices are added to ``remarks``.
    """
    kinds = ("JointState", *NUMBER_KINDS)
    chosen: list[list[str]] = []
    for key, names in (("drives", stated.drives), ("stage", stated.stage)):
        stated_topics = [_named(path, topics, name, f"bag.{key}", kinds) for name in names or ()]
        chosen.append([topic.name for topic in stated_topics if topic is not None])
    drives, stage = chosen
    if stated.drives is None:
        not_stage = {name: topic for name, topic in topics.items() if name not in stage}
        named = [name for name, topic in not_stage.items() if topic.kind in NUMBER_KINDS and _named_by_topic(name)]
        if stated.stage is None:
            stage = [name for name in named if _unit(_named_by_topic(name)) in ("m", "mm", "um")]
            named = [name for name in named if name not in stage]
        only = only_topic(path, not_stage, ("JointState",), "joints", 'bag.drives = ["{}"], or [] for none')
        drives = named + ([only.name] if only else [])
        if drives:
            remarks.append(f"the catheter's drives are taken from {', '.join(drives)}")
        if stage and stated.stage is None:
            remarks.append(f"the stage is taken from {', '.join(stage)}")
    return drives, stage


def _named_by_topic(name: str) -> str:
    """Returns the last part of the name of a topic if it is a NAME_UNIT, else an empty text."""
    last = name.rstrip("/").rpartition("/")[2]
    return last if _unit(last) else ""


def _unit(name: str) -> str:
    before, _, unit = name.rpartition("_")
    return unit.lower() if before and unit.lower() in ACTUATION_UNITS else ""


def _without_stamps(
    path: Path, topics: Mapping[str, Topic], taken: Sequence[str], stated: BagInfo, remarks: list[str]
) -> frozenset[str]:
    """Returns those of the topics ``taken`` that are placed at receive times, as ``bench.toml`` states; adds a remark.

    Raises TimeError for others without stamps of their own.
    """
    stated_topics = {"/" + name.strip("/") for name in stated.receive_times}
    by_receive_time = {name for name in taken if "/" + name.strip("/") in stated_topics}
    open_topics = {name for name in taken if topics[name].count and name not in by_receive_time}
    stamped: set[str] = set()
    for name, message in messages(path, sorted(open_topics)):
        if message.header_ns > 0:
            stamped.add(name)
            if stamped == open_topics:
                break
    unstamped = sorted(open_topics - stamped)
    if unstamped:
        line = ", ".join(f'"{name}"' for name in sorted({*unstamped, *by_receive_time}))
        raise TimeError(
            f"{path}: the messages of {', '.join(unstamped)} have no stamp of their own (header.stamp is 0 or missing)"
            "; to use the times at which they were received, which are late by the transport, state in bench.toml: "
            f"bag.receive_times = [{line}]"
        )
    if by_receive_time:
        names = ", ".join(sorted(by_receive_time))
        remarks.append(f"{names}: placed at the times at which the messages were received")
    return frozenset(by_receive_time)


@dataclass(slots=True)
class _Columns:
    """Collects the readings of topics of forces and drives.

    Attributes:
        path: the bag, for messages.
        received: topics whose messages are stamped with the times at which they were received.
        names: joint or topic -> NAME_UNIT of the drive, as ``bench.toml`` states.
        kinds: topic -> type of its messages.
        stamps: topic -> stamps of its messages in ns; the rows of ``wrenches`` and ``values`` belong to them.
        wrenches: topic -> forces (x, y, z), N.
        values: topic -> for each message the joints with their readings; a topic of numbers is a joint of its own name.
    """

    path: Path
    received: frozenset[str]
    names: Mapping[str, str]
    kinds: Mapping[str, str]
    stamps: dict[str, list[int]] = field(default_factory=dict[str, list[int]])
    wrenches: dict[str, list[tuple[float, float, float]]] = field(
        default_factory=dict[str, list[tuple[float, float, float]]]
    )
    values: dict[str, list[dict[str, float]]] = field(default_factory=dict[str, list[dict[str, float]]])

    def add(self, topic: str, message: BagMessage) -> None:
        """Adds a message of a topic of forces or drives."""
        stamp, content = _stamp(message, topic in self.received), message.content
        if stamp is None:
            return
        self.stamps.setdefault(topic, []).append(stamp)
        kind = self.kinds[topic]
        if kind in WRENCH_KINDS:
            vector = content.wrench.force if hasattr(content, "wrench") else content.force
            self.wrenches.setdefault(topic, []).append((float(vector.x), float(vector.y), float(vector.z)))
        elif kind == "JointState":
            positions = dict(zip(map(str, content.name), map(float, content.position), strict=False))
            self.values.setdefault(topic, []).append(positions)
        else:
            self.values.setdefault(topic, []).append({topic: float(content.data)})

    def force(self, topic: str) -> ForceLog:
        """Returns the readings of a sensor, N. Raises FileFormatError for a reading that no sensor gives."""
        force = np.array(self.wrenches.get(topic, []), np.float64).reshape(-1, 3)
        stamps, rows, remarks = self._in_order(topic)
        force = force[rows]
        outside = FORCE_RANGE.outside(force.ravel())
        if outside is not None:
            row, axis = divmod(outside, 3)
            raise FileFormatError(
                f"{self.path}, topic {topic}: the force at {stamps[row] * 1e-9:.3f} s is {force[row, axis]:g} N, "
                f"expected {FORCE_RANGE}; choose another topic in bench.toml: bag.force"
            )
        return ForceLog(stamps, force, None, f"force = {topic} (N)", remarks=remarks)

    def drives(self, topics: Sequence[str], remarks: list[str]) -> DriveLog | None:
        """Returns the readings of the drives of some topics at all their stamps; None without a reading.

        A drive is NaN at the stamps of the other topics. Remarks on the units are added to ``remarks``.

        Raises:
            InputError: the name of a joint has no unit, or a reading is outside of the range of its drive.
        """
        logs: list[tuple[IntArray, dict[str, FloatArray]]] = []  # for each topic: stamps, NAME_UNIT -> readings (n,)
        for topic in topics:
            stamps, rows, repeat_remarks = self._in_order(topic)
            remarks += repeat_remarks
            readings = [self.values[topic][row] for row in rows.tolist()] if topic in self.values else []
            columns: dict[str, FloatArray] = {}
            for joint in dict.fromkeys(name for row in readings for name in row):
                name, factor = self._name(topic, joint)
                if factor != 1.0:
                    si_unit = "radians" if _unit(name) == "deg" else "metres"
                    remarks.append(f"{name} is {joint} of {topic}, which a JointState holds in {si_unit}")
                columns[name] = factor * np.array([row.get(joint, math.nan) for row in readings])
                limits = actuation_range(name)
                outside = limits.outside(columns[name])
                if outside is not None:
                    raise InputError(
                        f"{self.path}, topic {topic}: {name} at {stamps[outside] * 1e-9:.3f} s is "
                        f"{columns[name][outside]:g}, expected {limits}; check the unit in bench.toml: bag.names"
                    )
            if columns:
                logs.append((stamps, columns))
        if not logs:
            return None
        all_stamps = np.unique(np.concatenate([stamps for stamps, _ in logs]))
        values = {name: np.full(len(all_stamps), math.nan) for _, columns in logs for name in columns}
        for stamps, columns in logs:
            for name, column in columns.items():
                values[name][np.searchsorted(all_stamps, stamps)] = column
        return DriveLog(all_stamps, values)

    def _name(self, topic: str, joint: str) -> tuple[str, float]:
        """Returns NAME_UNIT of a joint or topic, and the factor that converts its readings to this unit.

        A JointState is in radians and metres by its definition, so its readings are converted to the unit of the name
        that ``bag.names`` states. A joint that itself ends in a unit, as ``knob_deg``, is taken to be in that unit.

        Args:
            topic: the topic.
            joint: name of the joint in the message; the topic itself for messages of one number.

        Raises:
            InputError: the name does not end in a unit.
        """
        stated = self.names.get(joint) or self.names.get(joint.lstrip("/"))
        if self.kinds[topic] == "JointState" and stated:
            return stated, _PER_SI_UNIT.get(_unit(stated), 1.0)
        name = stated or (_named_by_topic(joint) if joint == topic else joint)
        if not _unit(name):
            raise InputError(
                f"{self.path}, topic {topic}: {joint!r} does not name its unit; state its name in bench.toml: "
                f'bag.names = {{ "{joint}" = "knob_deg" }}, or leave the topic out: bag.drives = []'
            )
        return name, 1.0

    def _in_order(self, topic: str) -> tuple[IntArray, IntArray, tuple[str, ...]]:
        """Returns the (m,) rising stamps of a topic, the messages that they belong to, and remarks on repeated stamps.

        Raises TimeError for a pause of more than a day: then the clocks of the messages differ.
        """
        stamps = np.array(self.stamps.get(topic, []), np.int64)
        order = np.argsort(stamps, kind="stable")
        keep = np.diff(stamps[order], prepend=-1) > 0
        if len(stamps) > 1 and np.diff(stamps[order]).max() > MAX_PAUSE_S * 1_000_000_000:
            raise TimeError(
                f"{self.path}, topic {topic}: its stamps are from {stamps.min() * 1e-9:.0f} to "
                f"{stamps.max() * 1e-9:.0f} s, with a pause of more than a day; to use the times at which the messages "
                f'were received instead, state in bench.toml: bag.receive_times = ["{topic}"]'
            )
        repeats = int(np.sum(~keep))
        remark = f"{topic}: {repeats} messages repeat the stamp of another and are left out"
        return stamps[order][keep], order[keep], (remark,) if repeats else ()
