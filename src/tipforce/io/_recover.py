"""The ``.part`` of a recording: locked while it is written; the undamaged part of one that was cut off is recovered."""

import importlib
import os
import struct
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer

from .._system.atomic import check_folder, part_of
from .._system.locks import lock_holder
from ..errors import FileFormatError, OutputError
from ._container import frame_is_whole, recovered_name, whole_summary
from ._facts import Fact, record_name

_HEAD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQII")
"""Start, end, uncompressed size, crc, length of the name of the compression."""


def finished_of(part: Path) -> Path:
    """Returns the final name of a ``.part``."""
    return part.with_name(part.name.removesuffix(".part"))


def lock(stream: IO[bytes], path: Path) -> None:
    """Holds a file for this process until it ends, so that no other process recovers an unfinished recording.

    Args:
        stream: the open file.
        path: its path, for the message.

    Raises:
        FileFormatError: another process holds it.
    """
    try:
        fcntl = importlib.import_module("fcntl")
    except ModuleNotFoundError:  # Windows: an open file can be neither renamed nor removed there, which is lock enough
        return
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        holder = lock_holder(finished_of(path)) or "another process"
        raise FileFormatError(f"{path}: is still being written by {holder}; open it when that has ended") from None


def origin_of(part: Path) -> str:
    """Returns the writer of a ``.part``: "record" or "import"; empty where even its start is unreadable."""
    with part.open("rb") as stream:
        try:
            for record in StreamReader(stream, emit_chunks=True).records:
                if isinstance(record, Metadata) and record.name == "tipforce.session":
                    return record.metadata.get("origin", "")
        except (McapError, ValueError, OSError, struct.error):  # cut off within a record
            return ""
    return ""


def check_target(path: Path, *, overwrite: bool, origin: str) -> None:
    """Checks before any work that ``path`` can be written and that nothing is lost by it.

    An import may replace the ``.part`` of another import, because its sources still exist. The ``.part`` of a recording
    holds the only copy of a run.

    Args:
        path: the new recording.
        overwrite: whether a recording of this name may be replaced.
        origin: its writer: "record", "live", "import" or "recover".

    Raises:
        OutputError: nothing can be written there, or another process is writing it.
        FileFormatError: it exists already, or the rest of one that a crash cut off.
    """
    check_folder(path)
    if holder := lock_holder(path):
        raise OutputError(f"{path}: is being written by {holder}; wait until it ends, or choose another name")
    if path.exists() and not overwrite:
        raise FileFormatError(f"{path}: exists already; choose another name or state overwrite=True")
    part = part_of(path)
    if part.exists() and not overwrite and not (origin == "import" == origin_of(part)) and part.stat().st_size:
        raise FileFormatError(
            f"{part}: holds a recording that was cut off; write its undamaged part to a new recording with "
            f"`tipforce import {part} -o {recovered_name(part)}`, or remove it"
        )


@dataclass
class _Findings:
    """Findings of reading a damaged file.

    Attributes:
        lost_bytes: size of the record in which the file is cut off.
        lost_s: times of the first and last message of each damaged chunk.
        messages: number of messages that were read.
        finished: whether the file has its index, which is written last.
        uncertain_metadata: whether the metadata may be damaged.
        last_s: time of the last message of a file that is cut off.
    """

    lost_bytes: int = 0
    lost_s: list[tuple[float, float]] = field(default_factory=list[tuple[float, float]])
    messages: int = 0
    finished: bool = False
    uncertain_metadata: bool = False
    last_s: float | None = None

    def lose(self, first_ns: int, last_ns: int) -> None:
        """Notes a chunk that cannot be read."""
        self.lost_s.append((first_ns * 1e-9, last_ns * 1e-9))

    def summary(self, name: str) -> str:
        """Returns one line on the losses in the file ``name``."""
        if self.finished and not (self.lost_s or self.uncertain_metadata):
            return f"{name} was whole: {self.messages} messages recovered"
        line = f"{name} was {'damaged' if self.finished else 'cut off'}: {self.messages} messages recovered"
        line += f", {self.lost_bytes} bytes of an unfinished record lost" if self.lost_bytes else ""
        if self.last_s is not None:
            line += f"; the last message is of {self.last_s:.3f} s, later ones are lost in all streams"
        if self.lost_s:
            shown = ", ".join(f"{first:.3f} to {last:.3f} s" for first, last in self.lost_s[:4])
            more = f" and {len(self.lost_s) - 4} more" if len(self.lost_s) > 4 else ""
            line += f", {len(self.lost_s)} damaged chunks lost ({shown}{more})"
        if self.uncertain_metadata:
            line += "; its metadata (session, tare, clock map) may be damaged, too: compare them with `inspect`"
        return line


def resolve(path: Path) -> tuple[Path, str]:
    """Returns the finished file to read for ``path``, and one line on its recovery (empty if there was none).

    Raises FileFormatError where neither the file nor its ``.part`` exists, or where the ``.part`` is of an import,
    which can be run again.
    """
    if path.name.endswith(".part"):
        target = finished_of(path)
        if target.exists():
            raise FileFormatError(
                f"{path}: cannot take the name {target.name}, which exists too; remove it, or write the undamaged "
                f"part of this one to another with `tipforce import {path} -o {recovered_name(path)}`"
            )
        return target, recover(path, target)
    part = part_of(path)
    if path.exists() or not part.exists():
        return path, ""
    if origin_of(part) == "import":
        raise FileFormatError(
            f"{path}: its import was cut off; run the import again, or write the undamaged part of it to a new "
            f"recording with `tipforce import {part} -o {recovered_name(part)}`"
        )
    return path, recover(part, path)


def recover_recording(damaged: Path, target: Path, *, overwrite: bool = False, facts: Sequence[Fact] = ()) -> str:
    """Writes the undamaged part of a recording to ``target``; ``damaged`` stays unchanged.

    Args:
        damaged: a recording (.mcap), or the rest of one after a crash (.mcap.part).
        target: the new recording.
        overwrite: whether to replace a recording that exists.
        facts: replace those of the recording: clock map, tare, ...

    Returns:
        One line on the losses; the new recording contains it, too.

    Raises:
        FileFormatError: it is no recording, none of it is undamaged, or another process is writing it.
    """
    if not damaged.is_file():
        raise FileFormatError(f"{damaged}: there is no such file")
    check_target(target, overwrite=overwrite, origin="recover")
    target.parent.mkdir(parents=True, exist_ok=True)
    return recover(damaged, target, keep=True, facts=facts)


def recover(part: Path, target: Path, *, keep: bool = False, facts: Sequence[Fact] = ()) -> str:
    """Writes the undamaged part of ``part`` to ``target``.

    Records are read one after the other up to the cut. Of a chunk that is cut itself, the messages before the cut are
    kept (our chunks are not compressed).

    Args:
        part: the damaged recording.
        target: the new recording.
        keep: whether ``part`` is kept; otherwise it is removed.
        facts: replace those of the recording.

    Returns:
        One line on the losses.

    Raises:
        FileFormatError: nothing is left, or another process is writing it.
    """
    unfinished = target.with_name(target.name + ".recovering")
    findings = _Findings()
    with part.open("rb") as source, unfinished.open("wb") as sink:
        lock(source, part)
        writer = Writer(sink, compression=CompressionType.NONE, chunk_size=4 << 20, enable_data_crcs=True)
        writer.start(profile="ros2", library="tipforce")
        schemas: dict[int, int] = {}  # number in the damaged file -> number in the new one
        channels: dict[int, int] = {}
        last_ns = 0
        for record in _records(source, findings):
            if isinstance(record, Schema) and record.id not in schemas:
                schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
            elif isinstance(record, Channel) and record.id not in channels and record.schema_id in schemas:
                channels[record.id] = writer.register_channel(
                    record.topic, record.message_encoding, schemas[record.schema_id], record.metadata
                )
            elif isinstance(record, Message) and record.channel_id in channels:
                findings.messages += 1
                last_ns = max(last_ns, record.log_time)
                channel = channels[record.channel_id]
                writer.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)
            elif isinstance(record, Metadata):
                writer.add_metadata(record.name, record.metadata)
        if not findings.finished and findings.messages:
            findings.last_s = last_ns * 1e-9
        losses = findings.summary(part.name if keep else target.name)
        if findings.messages:
            for fact in facts:
                writer.add_metadata(record_name(fact), fact.record())
            writer.add_metadata("tipforce.recovered", {"detail": losses})
            writer.finish()
            sink.flush()
            os.fsync(sink.fileno())
    if not findings.messages:
        unfinished.unlink()
        why = "no message in it is whole" if findings.finished else "was cut off before its first message was written"
        raise FileFormatError(f"{part}: {why}; nothing is in it, remove it")
    unfinished.replace(target)
    if not keep:
        part.unlink()
    return losses


def whole_records(stream: IO[bytes]) -> Iterator[object]:
    """Yields the undamaged records of a recording in the order in which they were written, also while it is written."""
    return _records(stream, _Findings())


def _records(stream: IO[bytes], findings: _Findings) -> Iterator[object]:
    """Yields the undamaged records, also those in chunks, up to the end of the file or of its undamaged part.

    A record is its opcode, its length and its content. Where a length is damaged, the index at the end of the file, if
    there is one, gives the position of the next chunk, and reading goes on there. ``findings`` is updated.
    """
    size = stream.seek(0, 2)
    summary = _index_of(stream, findings)
    chunks = {} if summary is None else {chunk.chunk_start_offset: chunk for chunk in summary.chunk_indexes}
    starts = sorted(chunks)
    if summary is not None:  # compared with its checksum, unlike the same records between the chunks
        yield from (*summary.schemas.values(), *summary.channels.values())
    stream.seek(0)
    if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
        raise FileFormatError(f"{stream.name}: is not the beginning of a recording (.mcap)")
    while True:
        start = stream.tell()
        head = stream.read(_HEAD.size)
        if len(head) < _HEAD.size:
            findings.lost_bytes += len(head) if head != MCAP0_MAGIC else 0
            return
        opcode, length = _HEAD.unpack(head)
        # the chunk that the index has here, and the number of the next chunk in the index
        chunk, following = chunks.get(start), bisect_right(starts, start)
        if chunk and (opcode != Opcode.CHUNK or length != chunk.chunk_length - _HEAD.size):
            findings.lose(chunk.message_start_time, chunk.message_end_time)
            # forward, but not beyond the next chunk, for any length that the index states
            end = starts[following] if following < len(starts) else size
            stream.seek(min(start + max(chunk.chunk_length, _HEAD.size), end))
            continue
        if following < len(starts) and stream.tell() + length > starts[following]:
            stream.seek(starts[following])  # the head of this record is damaged; the index has the next chunk
            continue
        if opcode in (Opcode.DATA_END, Opcode.FOOTER):  # the index follows, which is written anew
            return
        whole = stream.tell() + length <= size
        if opcode == Opcode.CHUNK:
            yield from _chunk(stream.read(min(length, size)), findings, whole)
        elif whole and opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.METADATA):
            yield _parse(opcode, stream.read(length))
        elif whole:
            stream.seek(length, 1)
        if not whole:
            findings.lost_bytes += min(_HEAD.size + length, size)
            return


def _index_of(stream: IO[bytes], findings: _Findings) -> Summary | None:
    """Returns the index at the end of the file; None where it is incomplete, as in a file that was cut off."""
    index = whole_summary(stream)
    if index is None:
        return None
    findings.finished = True
    try:
        findings.uncertain_metadata = not frame_is_whole(stream, *index)
    except (struct.error, ValueError, OSError):
        findings.uncertain_metadata = True
    return index[0]


def _chunk(raw: bytes, findings: _Findings, whole: bool) -> Iterator[object]:
    """Yields the records of a chunk: before the cut if it is cut off; only schemas and channels if it is damaged.

    Args:
        raw: the content of the chunk.
        findings: the findings, which are updated.
        whole: whether the chunk is complete.
    """
    if whole:
        try:
            records = breakup_chunk(Chunk.read(ReadDataStream(BytesIO(raw))), validate_crc=True)
        except Exception:  # a decompressor or parser met damage; each raises its own kind of error
            first, last = struct.unpack_from("<QQ", raw) if len(raw) >= _CHUNK_HEAD.size else (0, 0)
            findings.lose(first, last)
            # the damaged message is unknown, but schemas and channels that later messages need may be only here
            yield from (record for record in _inside(raw) if isinstance(record, Schema | Channel))
            return
        yield from records
        return
    yield from _inside(raw)


def _inside(raw: bytes) -> Iterator[object]:
    """Yields the complete records of an uncompressed chunk in order, as long as their lengths are possible."""
    if len(raw) < _CHUNK_HEAD.size:
        return
    name_length = _CHUNK_HEAD.unpack_from(raw)[-1]
    if name_length:  # compressed: it cannot be read without its end
        return
    offset = _CHUNK_HEAD.size + 8  # 8 bytes: the size of the records
    while offset + _HEAD.size <= len(raw):
        opcode, length = _HEAD.unpack_from(raw, offset)
        offset += _HEAD.size
        if offset + length > len(raw):
            return
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
            yield _parse(opcode, raw[offset : offset + length])
        offset += length


def _parse(opcode: int, raw: bytes) -> object:
    """Returns the record in ``raw``; None where it is damaged."""
    stream = ReadDataStream(BytesIO(raw))
    kind = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel, Opcode.METADATA: Metadata}
    try:
        return Message.read(stream, len(raw)) if opcode == Opcode.MESSAGE else kind[Opcode(opcode)].read(stream)
    except (McapError, ValueError, struct.error):
        return None
