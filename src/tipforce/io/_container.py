"""The MCAP file below the messages: finds chunks and messages by the index, and never reads the file as a whole.

All data that are read are compared with their checksum, as far as the file states one. The index at the end has its
own. The checksum of the data section covers everything before it, chunks too. Every uncompressed chunk states its own
as well, so the former is checked when a file is opened, without reading the chunks, and each chunk when it is read.
"""

import io
import os
import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import IO

import numpy as np
import numpy.typing as npt
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, ChunkIndex
from mcap.stream_reader import get_chunk_data_stream
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC

from .._system.checksums import combined_crc
from ..errors import FileFormatError
from ..types import IntArray

_OURS = "tipforce."
"""Prefix of the names of our metadata records; every recording of ours has one."""
MESSAGE_HEAD = 31
"""Bytes of a message record before its payload: opcode, length, channel, sequence, log time, publish time."""
MAX_CHUNK_BYTES = 1 << 30
"""Largest chunk that is read: a few kB can claim to unpack to any size."""
_INDEX_ENTRY = np.dtype([("time", "<u8"), ("offset", "<u8")])
_RECORD = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<BQQQQII")
"""Opcode, length, first and last time, size, crc, and the length of the name of the compression."""
_FOOTER = struct.Struct("<BQQQI")
"""Opcode, length, start of the summary, start of its offsets, crc."""
_DATA_END = struct.Struct("<BQI")
_FAULTS = (McapError, struct.error, ValueError, OverflowError, OSError, MemoryError)
"""Exceptions that the parser raises for damaged bytes."""


@dataclass(frozen=True, slots=True, eq=False)
class Entries:
    """Positions of the n messages of one channel in the order of their times.

    Attributes:
        time_ns: (n,) times.
        chunk: (n,) numbers of their chunks.
        offset: (n,) positions of the records in the uncompressed chunk, bytes.
    """

    time_ns: IntArray
    chunk: IntArray
    offset: IntArray


def recovery_advice(path: Path) -> str:
    """Returns the advice for a recording that is cut off or damaged; it ends a message."""
    return (
        f"copy it again from the computer that recorded it, or write its undamaged part to a new recording with "
        f"`tipforce import {path} -o {recovered_name(path)}`"
    )


def recovered_name(path: Path) -> Path:
    """Returns a name for the recording that keeps the undamaged part of ``path``."""
    return path.with_name(path.name.removesuffix(".part").removesuffix(".mcap") + "-recovered.mcap")


def whole_summary(stream: IO[bytes]) -> tuple[Summary, int] | None:
    """Returns the index at the end of a file and its position; None where it is cut off or its checksum differs."""
    size = stream.seek(0, 2)
    end = size - len(MCAP0_MAGIC) - _FOOTER.size
    if end < len(MCAP0_MAGIC):
        return None
    stream.seek(end)
    footer = stream.read(_FOOTER.size)
    opcode, length, start, _, crc = _FOOTER.unpack(footer)  # start: of the index; its crc includes the footer before it
    if stream.read() != MCAP0_MAGIC or opcode != Opcode.FOOTER or length != _FOOTER.size - _RECORD.size:
        return None
    if not len(MCAP0_MAGIC) <= start <= end:
        return None
    stream.seek(start)
    if crc and zlib.crc32(footer[:-4], zlib.crc32(stream.read(end - start))) != crc:
        return None
    stream.seek(0)
    try:
        summary = SeekingReader(stream, record_size_limit=size).get_summary()
    except _FAULTS:
        return None
    return None if summary is None else (summary, start)


def is_foreign_metadata(names: Iterable[str]) -> bool:
    """Returns whether none of the metadata records with these names belongs to a recording of ours."""
    return not any(name.startswith(_OURS) for name in names)


def is_foreign(path: Path) -> bool:
    """Returns whether ``path`` is a complete MCAP file of another program, that is, without metadata of ours."""
    with path.open("rb") as stream:
        index = whole_summary(stream)
    return index is not None and is_foreign_metadata(record.name for record in index[0].metadata_indexes)


def frame_is_whole(stream: IO[bytes], summary: Summary, start: int) -> bool:
    """Checks that all bytes before the index, except the content of the chunks, are as they were written.

    The file states one checksum (CRC-32) of all these bytes. It is combined from the checksums of its parts: those that
    each chunk states for its content, which is not read here, and those of the bytes between.

    Args:
        stream: the file.
        summary: its index.
        start: position of the index, bytes.

    Returns:
        False where a byte differs. True also where it cannot be determined: without the checksum of the data section,
        and where chunks are compressed.
    """
    stream.seek(start - _DATA_END.size)
    opcode, length, stated = _DATA_END.unpack(stream.read(_DATA_END.size))
    if opcode != Opcode.DATA_END or length != 4:
        return False
    if not stated or any(chunk.compression for chunk in summary.chunk_indexes):
        return True
    crcs: list[int] = []
    lengths: list[int] = []
    position = 0  # end of the bytes whose checksums are collected
    stream.seek(0)
    for chunk in sorted(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset):
        head_at = chunk.chunk_start_offset
        body_at = head_at + _CHUNK_HEAD.size + 8  # 8 bytes: the size of the content
        if head_at < position or body_at + chunk.uncompressed_size > start:
            return False
        before = stream.read(body_at - position)
        opcode, length, _, _, size, crc, compression = _CHUNK_HEAD.unpack_from(before, head_at - position)
        indexed = opcode == Opcode.CHUNK and length == chunk.chunk_length - _RECORD.size and not compression
        if not (indexed and size == chunk.uncompressed_size and length == _CHUNK_HEAD.size - 1 + size):
            return False
        if not crc:  # this chunk states no checksum, so that of the file cannot be combined
            return True
        crcs += [zlib.crc32(before), crc]
        lengths += [len(before), size]
        position = stream.seek(body_at + size)
    rest = stream.read(start - _DATA_END.size - position)
    return combined_crc([*crcs, zlib.crc32(rest)], [*lengths, len(rest)]) == stated


class Container:
    """One open ``.mcap`` with an index.

    Raises FileFormatError where it is cut off, of another program, without chunks, or differs from its checksums.
    """

    def __init__(self, path: Path) -> None:
        """Opens the file and reads its index; the four chunks that were read last stay in memory."""
        self.path = path
        self._stream = path.open("rb")
        try:
            self._open()
        except BaseException:
            self._stream.close()
            raise
        self.chunk_data = lru_cache(maxsize=4)(self._read_chunk)

    def _open(self) -> None:
        """Reads index and metadata, and compares them with their checksums. Raises FileFormatError; see the class."""
        path = self.path
        magic = self._stream.read(len(MCAP0_MAGIC))
        if not magic:
            raise FileFormatError(f"{path}: the file is empty, not a recording (.mcap)")
        if magic != MCAP0_MAGIC:
            raise FileFormatError(
                f"{path}: is not a recording (.mcap); a video or a folder of images becomes one with `tipforce import`"
            )
        index = whole_summary(self._stream)
        if index is None:
            raise FileFormatError(f"{path}: is cut off or damaged (no whole index at its end); {recovery_advice(path)}")
        summary, end = index
        if not summary.chunk_indexes and summary.statistics and summary.statistics.message_count:
            raise FileFormatError(f"{path}: has no index of its chunks; {recovery_advice(path)}")
        try:
            whole = frame_is_whole(self._stream, summary, end)
            self._stream.seek(0)
            metadata = list(SeekingReader(self._stream, record_size_limit=end).iter_metadata()) if whole else []
        except _FAULTS:
            whole, metadata = False, []
        if not whole:
            raise FileFormatError(
                f"{path}: is damaged: its metadata, or the index of its messages, differ from their checksum; "
                f"{recovery_advice(path)}"
            )
        self.metadata = {record.name: dict(record.metadata) for record in metadata}
        self.channels: dict[int, Channel] = dict(summary.channels)
        self.schema_names = {schema.id: schema.name for schema in summary.schemas.values()}
        self.chunks: list[ChunkIndex] = sorted(
            summary.chunk_indexes, key=lambda chunk: (chunk.message_start_time, chunk.chunk_start_offset)
        )

    def close(self) -> None:
        """Closes the file."""
        self._stream.close()

    def _read_at(self, place: int, size: int) -> bytes:
        """Returns up to ``size`` bytes at ``place``; none beyond the end of the file, where seeking may fail."""
        if place >= os.fstat(self._stream.fileno()).st_size:
            return b""
        self._stream.seek(place)
        return self._stream.read(size)

    def _damaged(self, number: int, why: str) -> FileFormatError:
        chunk = self.chunks[number]
        return FileFormatError(
            f"{self.path}: the stretch from {chunk.message_start_time * 1e-9:.3f} to "
            f"{chunk.message_end_time * 1e-9:.3f} s is damaged ({why}); {recovery_advice(self.path)}"
        )

    def _read_chunk(self, number: int) -> bytes:
        """Returns the uncompressed records of a chunk."""
        index = self.chunks[number]
        if max(index.uncompressed_size, index.chunk_length) > MAX_CHUNK_BYTES:
            raise self._damaged(number, f"a chunk larger than {MAX_CHUNK_BYTES >> 20} MiB")
        raw = self._read_at(index.chunk_start_offset, index.chunk_length)
        try:
            opcode, length = _RECORD.unpack_from(raw)
            chunk = Chunk.read(ReadDataStream(io.BytesIO(memoryview(raw)[_RECORD.size :])))
            if opcode != Opcode.CHUNK or length != len(raw) - _RECORD.size:
                raise ValueError("no chunk is at the position that the index states")
            if chunk.uncompressed_size != index.uncompressed_size:
                raise ValueError("its size is not that of the index")
            if chunk.compression == "":
                data = chunk.data
            else:
                stream, size = get_chunk_data_stream(chunk)
                data = stream.read(size)
            if len(data) != index.uncompressed_size:
                raise ValueError("its size is not the stated one")
            if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
                raise ValueError("its checksum differs")
        except (*_FAULTS, RuntimeError) as error:
            raise self._damaged(number, str(error) or type(error).__name__) from None
        return data

    def chunk_entries(self, number: int, channel: int) -> tuple[IntArray, IntArray]:
        """Returns times and offsets of a channel's messages in one chunk, in the order in which they were written.

        Args:
            number: number of the chunk, from 0.
            channel: id of the channel.

        Returns:
            (n,) times in ns and (n,) offsets of the records in the uncompressed chunk in bytes.

        Raises:
            FileFormatError: the index of the chunk's messages is damaged.
        """
        position = self.chunks[number].message_index_offsets.get(channel)
        if position is None:
            return np.empty(0, np.int64), np.empty(0, np.int64)
        head = self._read_at(position, 15)
        if len(head) < 15:
            raise self._damaged(number, "the index of its messages is cut off")
        opcode, length, owner, size = struct.unpack("<BQHI", head)  # size: bytes of the entries
        raw = self._stream.read(size) if size == length - 6 and length <= MAX_CHUNK_BYTES else b""
        if opcode != Opcode.MESSAGE_INDEX or owner != channel or len(raw) != length - 6 or size % _INDEX_ENTRY.itemsize:
            raise self._damaged(number, "no index of its messages is at the stated position")
        entries = np.frombuffer(raw, dtype=_INDEX_ENTRY)
        # a time beyond 2^63 ns would overflow, an offset beyond the chunk would crash the reader
        if len(entries) and (
            int(entries["time"].max()) >= 1 << 63
            or int(entries["offset"].max()) + MESSAGE_HEAD > self.chunks[number].uncompressed_size
        ):
            raise self._damaged(number, "the index of its messages points outside of it")
        return entries["time"].astype(np.int64), entries["offset"].astype(np.int64)

    def entries(self, channel: int) -> Entries:
        """Returns all messages of a channel, in the order of their times."""
        parts = [self.chunk_entries(number, channel) for number in range(len(self.chunks))]
        if not parts:
            return Entries(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0, np.int64))
        times = np.concatenate([times for times, _ in parts])
        offsets = np.concatenate([offsets for _, offsets in parts])
        chunks = np.repeat(np.arange(len(parts)), [len(times) for times, _ in parts])
        order = np.argsort(times, kind="stable")
        return Entries(times[order], chunks[order], offsets[order])

    def message_lengths(self, number: int, channel: int, times: IntArray, offsets: IntArray) -> IntArray:
        """Returns the (n,) lengths of the payloads of a channel's messages in a chunk, bytes.

        Args:
            number: number of the chunk.
            channel: the channel.
            times: (n,) times of the messages in the index, ns.
            offsets: (n,) offsets of their records in the chunk, bytes.

        Raises:
            FileFormatError: a record does not have the channel and the time that the index states.
        """
        data = np.frombuffer(self.chunk_data(number), np.uint8)
        heads = data[offsets[:, None] + np.arange(MESSAGE_HEAD)]  # (n, 31): length at byte 1, channel at 9, time at 15
        lengths = _number(heads, 1, "<u8").astype(np.int64) - (MESSAGE_HEAD - _RECORD.size)
        as_indexed = (heads[:, 0] == Opcode.MESSAGE) & (_number(heads, 9, "<u2") == channel)
        as_indexed &= _number(heads, 15, "<u8").astype(np.int64) == times
        # not offset + length: a length of nonsense would overflow
        as_indexed &= (lengths >= 0) & (lengths <= len(data) - MESSAGE_HEAD - offsets)
        if not as_indexed.all():
            raise self._damaged(number, "the index of its messages does not fit them")
        return lengths

    def payload(self, number: int, channel: int, time_ns: int, offset: int) -> memoryview:
        """Returns the content of one message.

        Args:
            number: number of the chunk, from 0.
            channel: id of the channel.
            time_ns: time of the message.
            offset: position of its record in the uncompressed chunk, bytes.

        Raises:
            FileFormatError: the chunk or the record is damaged.
        """
        data = self.chunk_data(number)
        (length,) = self.message_lengths(number, channel, np.array([time_ns]), np.array([offset])).tolist()
        return memoryview(data)[offset + MESSAGE_HEAD : offset + MESSAGE_HEAD + length]

    def in_time_order(self, channels: set[int]) -> Iterator[tuple[int, int, memoryview]]:
        """Yields time in ns, channel and payload of every message of some channels, in the order of their times.

        The times of chunks may overlap. A message waits until no later chunk can have an earlier one.
        """
        pending: list[tuple[int, int, int, int, memoryview]] = []  # time, chunk, offset, channel, payload
        for number, chunk in enumerate(self.chunks):
            present = channels & set(chunk.message_index_offsets)
            if present:
                records = memoryview(self.chunk_data(number))
                for channel in present:
                    times, offsets = self.chunk_entries(number, channel)
                    lengths = self.message_lengths(number, channel, times, offsets)
                    for time_ns, offset, length in zip(times.tolist(), offsets.tolist(), lengths.tolist(), strict=True):
                        payload = records[offset + MESSAGE_HEAD : offset + MESSAGE_HEAD + length]
                        pending.append((time_ns, number, offset, channel, payload))
            pending.sort(key=lambda entry: entry[:3])
            ready = len(pending)
            if number + 1 < len(self.chunks):
                next_start = self.chunks[number + 1].message_start_time
                ready = next((i for i, entry in enumerate(pending) if entry[0] >= next_start), ready)
            for time_ns, _, _, channel, payload in pending[:ready]:
                yield time_ns, channel, payload
            del pending[:ready]


def _number(heads: npt.NDArray[np.uint8], at: int, kind: str) -> IntArray:
    """Returns the (n,) numbers of ``kind`` that start at byte ``at`` of each of ``heads`` (n, bytes)."""
    return np.ascontiguousarray(heads[:, at : at + np.dtype(kind).itemsize]).view(kind)[:, 0]
