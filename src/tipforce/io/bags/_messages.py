"""Opens a bag and reads its topics, and its messages with their stamps."""

from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..._system.extras import import_extra
from ...errors import FileFormatError, InputError, TipforceError


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic of a bag.

    Attributes:
        name: its name.
        kind: type of the messages without its package, as "JointState".
        count: number of messages.
    """

    name: str
    kind: str
    count: int


@dataclass(frozen=True, slots=True)
class BagMessage:
    """A message of a bag.

    Attributes:
        header_ns: own stamp, 0 for none.
        received_ns: time of its recording.
        content: its fields.
    """

    header_ns: int
    received_ns: int
    content: Any


@contextmanager
def _opened(path: Path) -> Generator[Any]:
    """Opens the bag at ``path``. Raises FileFormatError for a damaged one."""
    highlevel, typesys = import_extra("rosbags.highlevel", "ros"), import_extra("rosbags.typesys", "ros")
    try:
        # bags of ROS 2 before 2023 do not hold the definitions of their messages
        message_types = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        with highlevel.AnyReader([path], default_typestore=message_types) as reader:
            yield reader
    except TipforceError:
        raise
    except Exception as error:  # a damaged bag raises errors of many kinds in the library and below it
        advice = "run `rosbag reindex` on it" if "not indexed" in str(error) else "copy it again, or repair it"
        if path.suffix == ".mcap":
            advice = "repair it with `mcap recover`"
        raise FileFormatError(f"{path}: is no bag that can be read ({error}); {advice}") from None


def topics_of(path: Path) -> dict[str, Topic]:
    """Returns name -> topic. Raises FileFormatError for a file that is no bag, MissingExtraError without rosbags."""
    with _opened(path) as reader:
        return {
            name: Topic(name, str(info.msgtype or "").rpartition("/")[2], int(info.msgcount))
            for name, info in reader.topics.items()
        }


def messages(path: Path, names: Sequence[str]) -> Iterator[tuple[str, BagMessage]]:
    """Yields topic and message of all messages of some topics, in the order in which they were received.

    Args:
        path: the bag.
        names: names of the topics.

    Raises:
        FileFormatError: a message is not of its type.
    """
    with _opened(path) as reader:
        chosen = [connection for connection in reader.connections if connection.topic in names]
        # without a connection the library would yield all messages
        for connection, received_ns, raw in reader.messages(connections=chosen) if chosen else ():
            content: Any = reader.deserialize(raw, connection.msgtype)
            stamp = getattr(getattr(content, "header", None), "stamp", None)
            header_ns = 0 if stamp is None else int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
            yield connection.topic, BagMessage(header_ns, int(received_ns), content)


def only_topic(path: Path, topics: Mapping[str, Topic], kinds: Sequence[str], content: str, line: str) -> Topic | None:
    """Returns the only topic of the types ``kinds``; None without one.

    Args:
        path: the bag, for the message.
        topics: the topics of the bag.
        kinds: the message types.
        content: their content, for the message.
        line: the line of ``bench.toml`` that chooses, with {} for the topic.

    Raises:
        InputError: there are several.
    """
    fitting = [topic for topic in topics.values() if topic.kind in kinds and topic.count]
    if len(fitting) > 1:
        raise InputError(
            f"{path}: has several topics of {content}: {listed_topics(fitting)}; state one in bench.toml: "
            f"{line.format(fitting[0].name)}"
        )
    return fitting[0] if fitting else None


def listed_topics(topics: Sequence[Topic]) -> str:
    """Lists topics for a message."""
    shown = ", ".join(f"{topic.name} ({topic.kind}, {topic.count} messages)" for topic in topics[:12])
    return shown + (f" and {len(topics) - 12} more" if len(topics) > 12 else "")
