"""Writes a recording so that a kill -9 costs at most its last second."""

import contextlib
import os
import threading
from collections.abc import Generator, Iterator
from dataclasses import replace
from pathlib import Path
from typing import IO, Self

import numpy as np
from mcap.records import Channel, Message
from mcap.writer import CompressionType, Writer

from .._system.atomic import REMEDIES, atomic_text, part_of
from .._system.locks import output_lock
from ..errors import FileFormatError, OutputError, TimeError
from ..types import (
    Clock,
    Event,
    FloatArray,
    ForceEstimate,
    Frame,
    IntArray,
    SensorInfo,
    SessionInfo,
    SimulatedClock,
    SystemClock,
    Wrench,
)
from ._cdr import (
    COMPRESSED_IMAGE,
    ESTIMATE,
    FORCE_ESTIMATE,
    JOINT_STATE,
    SCHEMAS,
    WRENCH_STAMPED,
    pack_estimate,
    pack_image,
    pack_joints,
    pack_wrench,
    unpack_image,
)
from ._facts import Fact, record_name, session_record
from ._images import decode_image, encode_image
from ._recover import check_target, lock, whole_records
from .tables import MAX_STAMP_S

LIBRARY = "tipforce"
FLUSH_AGE_NS = 250_000_000
"""Age at which pending messages are handed to the operating system; the target is 0.5 s, the limit 1 s."""
MAX_CHUNK_NS = 500_000_000
"""Longest recorded time in one chunk; reading a single frame costs one chunk."""
MAX_CHUNK_BYTES = 4 << 20
_COMPRESSED = "/compressed"
"""Suffix of the topic of a stream of images."""


class RecordingWriter:
    """Writes ``path + ".part"``, renamed to ``path`` when closed without an error; a context manager.

    The file has the ROS 2 profile and uncompressed chunks (images are compressed already, and other messages are then
    read as arrays). Each chunk is at most half a second long and is handed to the operating system when it is a quarter
    of a second old, also while no event arrives. After an error inside the ``with`` block the ``.part`` stays: the next
    reader recovers it.

    Args:
        path: the recording.
        info: metadata of the session.
        lossless: whether images are written as PNG instead of JPEG.
        jpeg_quality: quality of a JPEG, 0 to 100.
        clock: gives the age of pending messages. With a simulated clock, chunks end only where events are written, so
            that the same events give the same bytes.
        overwrite: whether ``path`` may be replaced.
        origin: the writer: "record", "live" or "import".

    Raises:
        FileFormatError: ``path`` exists and ``overwrite`` is False, or the ``.part`` of an earlier run is not yet
            recovered.
        OutputError: nothing can be written there, or another process is writing it. Every method that writes raises it
            where the file can no longer be written, or is removed; its message states how much is kept and where. A
            ``.part`` in which nothing would be kept is removed.
    """

    def __init__(
        self,
        path: Path | str,
        info: SessionInfo,
        *,
        lossless: bool = False,
        jpeg_quality: int = 90,
        clock: Clock | None = None,
        overwrite: bool = False,
        origin: str = "record",
    ) -> None:
        """Locks and opens the ``.part``, writes the session metadata, and starts the thread that flushes."""
        self.path, self.part = Path(path), part_of(Path(path))
        check_target(self.path, overwrite=overwrite, origin=origin)
        self._lossless, self._quality = lossless, jpeg_quality
        self._clock = clock or SystemClock()
        with contextlib.ExitStack() as held:
            held.enter_context(output_lock(self.path))
            self._stream = held.enter_context(self._opened())
            lock(self._stream, self.part)
            self._stream.truncate(0)  # only now that nobody else is known to write it
            self._stream.seek(0)
            self._held = held.pop_all()
        self._mcap = Writer(
            self._stream, chunk_size=MAX_CHUNK_BYTES, compression=CompressionType.NONE, enable_data_crcs=True
        )
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._sequence: dict[int, int] = {}
        self._pending_since: int | None = None
        self._span: tuple[int, int] | None = None
        self._kept: tuple[int, int] | None = None
        """First and last stamp in the file."""
        self._closed = False
        self._failed: OutputError | None = None
        self._whole = 0
        """Bytes of the ``.part`` up to the end of its last complete record."""
        self._info, self._origin = info, origin
        with self._keeping_whole_records():
            self._mcap.start(profile="ros2", library=LIBRARY)
            self._mcap.add_metadata("tipforce.session", {"origin": origin, **session_record(info)})
            self._stream.flush()
            self._whole = self._stream.tell()
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._flusher = threading.Thread(target=self._flush_while_idle, name="recording-flush", daemon=True)
        if not isinstance(self._clock, SimulatedClock):
            self._flusher.start()

    def write(self, event: Event) -> None:
        """Writes one event; compresses frames. Raises TimeError for a stamp below zero or beyond `MAX_STAMP_S`."""
        self._check_stamp(event.stamp_ns)
        if isinstance(event, Frame):
            encoding, data = encode_image(event.image, lossless=self._lossless, jpeg_quality=self._quality)
            message = pack_image(event.stamp_ns, event.view, encoding, data)
            self._add(f"/{event.view}{_COMPRESSED}", COMPRESSED_IMAGE, event.stamp_ns, message)
        elif isinstance(event, Wrench):
            message = pack_wrench(event.stamp_ns, event.frame, event.force_n, event.torque_nm)
            self._add("/force", WRENCH_STAMPED, event.stamp_ns, message)
        else:
            self._add(f"/{event.stream}", JOINT_STATE, event.stamp_ns, pack_joints(event.stamp_ns, event.values))

    def write_estimate(self, estimate: ForceEstimate) -> None:
        """Writes one estimate into the stream "estimate". Raises TimeError as `write` does."""
        self._check_stamp(estimate.stamp_ns)
        message = pack_estimate(estimate.stamp_ns, estimate)
        self._add(f"/{ESTIMATE}", FORCE_ESTIMATE, estimate.stamp_ns, message)

    def state(self, fact: Fact | SensorInfo) -> None:
        """Writes a fact about the run; the last one of its kind holds. A sensor replaces that of the metadata."""
        if isinstance(fact, SensorInfo):
            self._info = replace(self._info, sensor=fact)
            self.note("tipforce.session", {"origin": self._origin, **session_record(self._info)})
            return
        self.note(record_name(fact), fact.record())

    def note(self, name: str, record: dict[str, str]) -> None:
        """Writes a metadata record; the last one of a name holds.

        Args:
            name: any name.
            record: its values as text.
        """
        with self._lock, self._keeping_whole_records():
            self._mcap.add_metadata(name, record)
            self._stream.flush()
            self._whole = self._stream.tell()

    def written_frames(self) -> Iterator[Frame]:
        """Yields the frames written until now, in that order, with the losses of their compression."""
        with self._lock:
            self._flush()
        with self.part.open("rb") as stream:
            views: dict[int, str] = {}
            for record in whole_records(stream):
                if isinstance(record, Channel) and record.topic.endswith(_COMPRESSED):
                    views[record.id] = record.topic[1 : -len(_COMPRESSED)]
                elif isinstance(record, Message) and record.channel_id in views:
                    data = unpack_image(record.data)[2]
                    yield Frame(record.log_time, decode_image(data, str(self.part)), views[record.channel_id])

    def close(self) -> None:
        """Finishes the file and gives it its name."""
        if self._closed:
            return
        self._halt()
        with self._keeping_whole_records():
            self._mcap.finish()
            self._stream.flush()
            os.fsync(self._stream.fileno())
            self._check_in_place()
            self.part.replace(self.path)
        self._held.close()

    def abandon(self) -> None:
        """Stops and removes the file: for a recording that can be made again from its sources."""
        if not self._closed:
            self._halt()
        self._held.close()
        self.part.unlink(missing_ok=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if error is None:
            self.close()
        else:
            self.leave_part()

    def leave_part(self) -> None:
        """Stops and leaves the file as ``.part``, after an error, which is the one to show."""
        if self._closed:
            return
        self._halt()
        with contextlib.suppress(OSError, OutputError):
            if not self._failed:
                self._flush()
        with contextlib.suppress(OSError):
            self._held.close()

    @property
    def kept_s(self) -> float:
        """Seconds of the recording that are in the file."""
        return 0.0 if self._kept is None else (self._kept[1] - self._kept[0]) * 1e-9

    def _opened(self) -> IO[bytes]:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            return self.part.open("ab")
        except OSError as error:
            raise OutputError(f"{self.path}: cannot be written, {_why(error)}") from None

    @contextlib.contextmanager
    def _keeping_whole_records(self) -> Generator[None]:
        """Surrounds every write to the file: where the disk is full, half a record must not stay at its end."""
        if self._failed:
            raise self._failed
        try:
            yield
        except OSError as error:
            raise self._fail(f"{self.path}: cannot be written any more, {_why(error)}") from error

    def _check_in_place(self) -> None:
        """Raises OutputError where the ``.part`` was removed or moved: further messages would be lost."""
        try:
            in_place = os.path.samestat(self.part.stat(), os.fstat(self._stream.fileno()))
        except FileNotFoundError:
            in_place = False
        if not in_place:
            raise self._fail(f"{self.path}: cannot be written any more, {self.part} was removed or moved")

    def _fail(self, why: str) -> OutputError:
        """Ends the writing; the error states how much of the recording is left."""
        file = os.dup(self._stream.fileno())  # stays open when the stream is closed below
        self._failed = OutputError(f"{why}; {self._left(os.fstat(file).st_nlink)}")
        with contextlib.suppress(OSError):  # its buffer cannot be written either
            self._held.close()
        os.ftruncate(file, self._whole)
        os.close(file)
        if self._kept is None:
            self.part.unlink(missing_ok=True)
        return self._failed

    def _left(self, links: int) -> str:
        """Returns the remainder of the recording, for a message; the file has ``links`` names, 0 if it was removed."""
        if links == 0 or self._kept is None:
            return "nothing of this recording is kept"
        where = f"{self.part}" if self.part.exists() else f"{self.part.name}, wherever it was moved to"
        return f"{self.kept_s:.1f} s of this recording are kept in {where}"

    def _halt(self) -> None:
        self._closed = True
        self._stop.set()
        if self._flusher.is_alive():
            self._flusher.join()

    def _check_stamp(self, stamp_ns: int) -> None:
        if stamp_ns >= MAX_STAMP_S * 1_000_000_000:
            raise TimeError(f"{self.path}: the stamp {stamp_ns} ns is beyond the year 2038; check its unit")
        if stamp_ns < 0:
            raise TimeError(f"{self.path}: the stamp {stamp_ns} ns is before zero, which the format cannot hold")

    def _add(self, topic: str, schema: str, stamp_ns: int, message: bytes) -> None:
        """Adds a packed message to the current chunk, and ends the chunk when it is old or long enough."""
        with self._lock:
            if self._closed:
                raise FileFormatError(f"{self.path}: the recording is closed")
            channel = self._channels.get(topic) or self._register(topic, schema)
            sequence = self._sequence.get(channel, 0)
            self._sequence[channel] = sequence + 1
            with self._keeping_whole_records():  # a full chunk is written here
                self._mcap.add_message(channel, stamp_ns, message, stamp_ns, sequence)
            now = self._clock.now_ns()
            if self._pending_since is None:
                self._pending_since = now
            first, last = self._span or (stamp_ns, stamp_ns)
            self._span = min(first, stamp_ns), max(last, stamp_ns)
            if now - self._pending_since >= FLUSH_AGE_NS or self._span[1] - self._span[0] >= MAX_CHUNK_NS:
                self._flush()

    def _register(self, topic: str, schema: str) -> int:
        if schema not in self._schemas:
            self._schemas[schema] = self._mcap.register_schema(schema, "ros2msg", SCHEMAS[schema].encode())
        self._channels[topic] = self._mcap.register_channel(topic, "cdr", self._schemas[schema])
        return self._channels[topic]

    def _flush(self) -> None:
        """Ends the current chunk and hands it to the operating system; the caller holds the lock."""
        with self._keeping_whole_records():
            self._mcap.flush()
            self._check_in_place()
            self._whole = self._stream.tell()
        if self._span is not None:
            first, last = self._kept or self._span
            self._kept = min(first, self._span[0]), max(last, self._span[1])
        self._pending_since, self._span = None, None

    def _flush_while_idle(self) -> None:
        while not self._stop.wait(FLUSH_AGE_NS * 1e-9):
            with self._lock:
                if self._pending_since is not None and self._clock.now_ns() - self._pending_since >= FLUSH_AGE_NS:
                    with contextlib.suppress(OutputError):  # kept, and raised where the next event is written
                        self._flush()


def _why(error: OSError) -> str:
    """Returns the refusal of the operating system, and the remedy."""
    return REMEDIES.get(error.errno or 0, f"{error.strerror or error}; choose another place")


def write_force_csv(path: Path | str, stamps_ns: IntArray, force_n: FloatArray) -> None:
    """Writes a force log ``stamp_ns,fx_n,fy_n,fz_n``.

    Args:
        path: the file.
        stamps_ns: (n,) stamps.
        force_n: (n, 3) forces, N; an axis that is NaN throughout is left out.
    """
    axes = [axis for axis in range(3) if not np.isnan(force_n[:, axis]).all()]
    with atomic_text(Path(path)) as out:
        out.write(",".join(["stamp_ns", *(f"f{'xyz'[axis]}_n" for axis in axes)]) + "\n")
        for stamp, row in zip(stamps_ns.tolist(), force_n[:, axes].tolist(), strict=True):
            out.write(",".join([str(stamp), *(f"{value:.6g}" for value in row)]) + "\n")
