"""The ``.part`` of a recording: locked while it is written; once cut off, what is whole in it becomes a valid file."""

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
_CHUNK_HEAD = struct.Struct("<QQQII")  # start, end, uncompressed size, crc, length of the compression's name


def finished_of(part: Path) -> Path:
    """What a ``.part`` will be called."""
    return part.with_name(part.name.removesuffix(".part"))


def lock(stream: IO[bytes], path: Path) -> None:
    """Hold ``path`` for this process until it ends, so that nobody recovers what is still being written.

    Raises FileFormatError where another process holds it.
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
    """Who wrote a ``.part``: "record", "import", or empty where even its start is unreadable."""
    with part.open("rb") as stream:
        try:
            for record in StreamReader(stream, emit_chunks=True).records:
                if isinstance(record, Metadata) and record.name == "tipforce.session":
                    return record.metadata.get("origin", "")
        except (McapError, ValueError, OSError, struct.error):  # cut within a record
            return ""
    return ""


def check_target(path: Path, *, overwrite: bool, origin: str) -> None:
    """Checks before any work that ``path`` can be written and that nothing would be destroyed by it.

    The ``.part`` of an import may be replaced by another import: its sources are still there. That of a recording
    holds the only copy of a run.

    Args:
        path: the recording to be.
        overwrite: whether a recording of this name may be replaced.
        origin: who writes it: "record", "live", "import" or "recover".

    Raises:
        OutputError: nothing can be written there, or somebody is writing it.
        FileFormatError: it exists already, or what a crash left of it.
    """
    check_folder(path)
    if holder := lock_holder(path):
        raise OutputError(f"{path}: is being written by {holder}; wait until it ends, or choose another name")
    if path.exists() and not overwrite:
        raise FileFormatError(f"{path}: exists already; choose another name or state overwrite=True")
    part = part_of(path)
    if part.exists() and not overwrite and not (origin == "import" == origin_of(part)) and part.stat().st_size:
        raise FileFormatError(
            f"{part}: holds a recording that was cut off; write what is in it to a new recording with "
            f"`tipforce import {part} -o {recovered_name(part)}`, or remove it"
        )


@dataclass
class _Findings:
    """What a walk through a damaged file came across."""

    lost_bytes: int = 0
    lost_s: list[tuple[float, float]] = field(default_factory=list[tuple[float, float]])
    messages: int = 0
    finished: bool = False
    uncertain_metadata: bool = False
    last_s: float | None = None

    def lose(self, first_ns: int, last_ns: int) -> None:
        """Note a chunk that cannot be read."""
        self.lost_s.append((first_ns * 1e-9, last_ns * 1e-9))

    def said(self, name: str) -> str:
        """One line on what was lost."""
        if self.finished and not (self.lost_s or self.uncertain_metadata):
            return f"{name} was whole: {self.messages} messages recovered"
        said = f"{name} was {'damaged' if self.finished else 'cut off'}: {self.messages} messages recovered"
        said += f", {self.lost_bytes} bytes of an unfinished record lost" if self.lost_bytes else ""
        if self.last_s is not None:
            said += f"; the last message is of {self.last_s:.3f} s, what came later is lost in all streams"
        if self.lost_s:
            shown = ", ".join(f"{first:.3f} to {last:.3f} s" for first, last in self.lost_s[:4])
            more = f" and {len(self.lost_s) - 4} more" if len(self.lost_s) > 4 else ""
            said += f", {len(self.lost_s)} damaged chunks lost ({shown}{more})"
        if self.uncertain_metadata:
            said += "; its metadata (session, tare, clock map) may be damaged, too: compare what `inspect` shows"
        return said


def resolve(path: Path) -> tuple[Path, str]:
    """The finished file to read for ``path``, and what had to be recovered for it (empty: nothing).

    Raises FileFormatError where there is neither the file nor its ``.part``, or where the ``.part`` is an import that
    can be run again.
    """
    if path.name.endswith(".part"):
        target = finished_of(path)
        if target.exists():
            raise FileFormatError(
                f"{path}: cannot take the name {target.name}, which exists too; remove "
                f"it, or write what is in it to another one with `tipforce import {path} -o {recovered_name(path)}`"
            )
        return target, recover(path, target)
    part = part_of(path)
    if path.exists() or not part.exists():
        return path, ""
    if origin_of(part) == "import":
        raise FileFormatError(
            f"{path}: its import was cut off; run the import again, or write what is in it to a new "
            f"recording with `tipforce import {part} -o {recovered_name(part)}`"
        )
    return path, recover(part, path)


def recover_recording(damaged: Path, target: Path, *, overwrite: bool = False, facts: Sequence[Fact] = ()) -> str:
    """Write what is whole in a recording that is cut off or damaged to ``target``; ``damaged`` stays as it is.

    Args:
        damaged: a recording (.mcap), or what a crash left of one (.mcap.part).
        target: the new recording.
        overwrite: replace one that is there already.
        facts: stated in the new recording in place of its own: clock map, tare, ...

    Returns:
        One line on what was lost, which the new recording carries, too.

    Raises:
        FileFormatError: it is no recording, nothing in it is whole, or somebody still writes it.
    """
    if not damaged.is_file():
        raise FileFormatError(f"{damaged}: there is no such file")
    check_target(target, overwrite=overwrite, origin="recover")
    target.parent.mkdir(parents=True, exist_ok=True)
    return recover(damaged, target, keep=True, facts=facts)


def recover(part: Path, target: Path, *, keep: bool = False, facts: Sequence[Fact] = ()) -> str:
    """Write what is whole in ``part`` to ``target``, then remove ``part`` unless it is to be kept; says what was lost.

    Records are read one after the other up to the cut; of a chunk that is cut itself the messages before the cut are
    kept (our chunks are not compressed). Raises FileFormatError where nothing is left or somebody still writes.
    """
    made = target.with_name(target.name + ".recovering")
    found = _Findings()
    with part.open("rb") as source, made.open("wb") as sink:
        lock(source, part)
        writer = Writer(sink, compression=CompressionType.NONE, chunk_size=4 << 20, enable_data_crcs=True)
        writer.start(profile="ros2", library="tipforce")
        schemas: dict[int, int] = {}
        channels: dict[int, int] = {}
        last_ns = 0
        for record in _records(source, found):
            if isinstance(record, Schema) and record.id not in schemas:
                schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
            elif isinstance(record, Channel) and record.id not in channels and record.schema_id in schemas:
                channels[record.id] = writer.register_channel(
                    record.topic, record.message_encoding, schemas[record.schema_id], record.metadata
                )
            elif isinstance(record, Message) and record.channel_id in channels:
                found.messages += 1
                last_ns = max(last_ns, record.log_time)
                channel = channels[record.channel_id]
                writer.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)
            elif isinstance(record, Metadata):
                writer.add_metadata(record.name, record.metadata)
        if not found.finished and found.messages:
            found.last_s = last_ns * 1e-9
        said = found.said(part.name if keep else target.name)
        if found.messages:
            for fact in facts:
                writer.add_metadata(record_name(fact), fact.record())
            writer.add_metadata("tipforce.recovered", {"detail": said})
            writer.finish()
            sink.flush()
            os.fsync(sink.fileno())
    if not found.messages:
        made.unlink()
        why = "no message in it is whole" if found.finished else "was cut off before its first message was written"
        raise FileFormatError(f"{part}: {why}; nothing is in it, remove it")
    made.replace(target)
    if not keep:
        part.unlink()
    return said


def whole_records(stream: IO[bytes]) -> Iterator[object]:
    """Whole records of a recording, in the order in which they were written, also while it is being written."""
    return _records(stream, _Findings())


def _records(stream: IO[bytes], found: _Findings) -> Iterator[object]:
    """Whole records, those inside of chunks too, up to the end of the file or of what is whole in it."""
    size = stream.seek(0, 2)
    summary = _index_of(stream, found)
    chunks = {} if summary is None else {chunk.chunk_start_offset: chunk for chunk in summary.chunk_indexes}
    starts = sorted(chunks)
    if summary is not None:  # held to its checksum, which the same records between the chunks are not
        yield from (*summary.schemas.values(), *summary.channels.values())
    stream.seek(0)
    if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
        raise FileFormatError(f"{stream.name}: is not the beginning of a recording (.mcap)")
    while True:
        start = stream.tell()
        head = stream.read(_HEAD.size)
        if len(head) < _HEAD.size:
            found.lost_bytes += len(head) if head != MCAP0_MAGIC else 0
            return
        opcode, length = _HEAD.unpack(head)
        chunk, following = chunks.get(start), bisect_right(starts, start)
        if chunk and (opcode != Opcode.CHUNK or length != chunk.chunk_length - _HEAD.size):
            found.lose(chunk.message_start_time, chunk.message_end_time)
            # forward, and not beyond the next chunk, whatever length the index states
            end = starts[following] if following < len(starts) else size
            stream.seek(min(start + max(chunk.chunk_length, _HEAD.size), end))
            continue
        if following < len(starts) and stream.tell() + length > starts[following]:
            stream.seek(
                starts[following]
            )  # the head of this record is hurt; the index tells where the next chunk begins
            continue
        if opcode in (Opcode.DATA_END, Opcode.FOOTER):  # what follows is the index, which is made anew
            return
        whole = stream.tell() + length <= size
        if opcode == Opcode.CHUNK:
            yield from _chunk(stream.read(min(length, size)), found, whole)
        elif whole and opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.METADATA):
            yield _parse(opcode, stream.read(length))
        elif whole:
            stream.seek(length, 1)
        if not whole:
            found.lost_bytes += min(_HEAD.size + length, size)
            return


def _index_of(stream: IO[bytes], found: _Findings) -> Summary | None:
    """The index at the end of the file; None where it is not whole, as in a file that was cut off."""
    index = whole_summary(stream)
    if index is None:
        return None
    found.finished = True
    try:
        found.uncertain_metadata = not frame_is_whole(stream, *index)
    except (struct.error, ValueError, OSError):
        found.uncertain_metadata = True
    return index[0]


def _chunk(raw: bytes, found: _Findings, whole: bool) -> Iterator[object]:
    """The records of one chunk; of a chunk that is cut, those before the cut; of a damaged one no message."""
    if whole:
        try:
            records = breakup_chunk(Chunk.read(ReadDataStream(BytesIO(raw))), validate_crc=True)
        except Exception:  # a decompressor or parser that met damage; each raises its own kind
            first, last = struct.unpack_from("<QQ", raw) if len(raw) >= _CHUNK_HEAD.size else (0, 0)
            found.lose(first, last)
            # which message is hurt cannot be determined, but what the later ones need may stand here alone
            yield from (record for record in _inside(raw) if isinstance(record, Schema | Channel))
            return
        yield from records
        return
    yield from _inside(raw)


def _inside(raw: bytes) -> Iterator[object]:
    """Whole records of an uncompressed chunk, one after the other, as far as their lengths make sense."""
    if len(raw) < _CHUNK_HEAD.size:
        return
    name_length = _CHUNK_HEAD.unpack_from(raw)[-1]
    at = _CHUNK_HEAD.size + name_length + 8
    if name_length:  # compressed: nothing of it can be told without its end
        return
    while at + _HEAD.size <= len(raw):
        opcode, length = _HEAD.unpack_from(raw, at)
        at += _HEAD.size
        if at + length > len(raw):
            return
        if opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
            yield _parse(opcode, raw[at : at + length])
        at += length


def _parse(opcode: int, raw: bytes) -> object:
    stream = ReadDataStream(BytesIO(raw))
    kind = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel, Opcode.METADATA: Metadata}
    try:
        return Message.read(stream, len(raw)) if opcode == Opcode.MESSAGE else kind[Opcode(opcode)].read(stream)
    except (McapError, ValueError, struct.error):  # its length or its text is hurt
        return None
