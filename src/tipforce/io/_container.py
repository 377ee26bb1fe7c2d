"""The MCAP file below the messages: what lies where, read by chunk and never as a whole."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, ChunkIndex
from mcap.stream_reader import StreamReader, get_chunk_data_stream

from ..errors import FileFormatError
from ..types import IntArray

__all__ = ["MESSAGE_HEAD", "Container", "Entries"]

MESSAGE_HEAD = 31
"""Bytes of a message record before its payload: opcode, length, channel, sequence, log time, publish time."""
_INDEX_ENTRY = np.dtype([("time", "<u8"), ("offset", "<u8")])


@dataclass(frozen=True, slots=True, eq=False)
class Entries:
    """Where the messages of one channel lie, in the order of their times: ``time_ns``, ``chunk``, ``offset`` (n,)."""

    time_ns: IntArray
    chunk: IntArray
    offset: IntArray


class Container:
    """One open ``.mcap`` with an index. Raises FileFormatError where it is cut off, foreign or without chunks."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._stream = path.open("rb")
        try:
            self._open()
        except BaseException:
            self._stream.close()
            raise
        self.chunk_data = lru_cache(maxsize=4)(self._read_chunk)

    def _open(self) -> None:
        path = self.path
        if not self._stream.read(1):
            raise FileFormatError(f"{path}: the file is empty, not a recording (.mcap)")
        self._stream.seek(0)
        try:
            reader = SeekingReader(self._stream)
        except (McapError, struct.error):
            raise FileFormatError(
                f"{path}: is not a recording (.mcap); a video or a folder of images becomes one with `tipforce import`"
            ) from None
        try:
            summary = reader.get_summary()
            self.metadata = {record.name: dict(record.metadata) for record in reader.iter_metadata()} if summary else {}
        except (McapError, struct.error, ValueError, OSError):
            raise FileFormatError(
                f"{path}: is cut off or damaged (no index at its end); rename it to {path.name}.part and open "
                f"{path.name} again to recover what is whole in it"
            ) from None
        if summary is None or (not summary.chunk_indexes and summary.statistics and summary.statistics.message_count):
            raise FileFormatError(
                f"{path}: has no index; rename it to {path.name}.part and open {path.name} again to make one"
            )
        self.channels: dict[int, Channel] = dict(summary.channels)
        self.schema_names = {schema.id: schema.name for schema in summary.schemas.values()}
        self.chunks: list[ChunkIndex] = sorted(
            summary.chunk_indexes, key=lambda chunk: (chunk.message_start_time, chunk.chunk_start_offset)
        )

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    def _read_chunk(self, number: int) -> bytes:
        """The uncompressed records of a chunk."""
        index = self.chunks[number]
        self._stream.seek(index.chunk_start_offset)
        try:
            record = next(StreamReader(self._stream, skip_magic=True, emit_chunks=True).records)
            assert isinstance(record, Chunk)
            if record.compression == "" and len(record.data) == index.uncompressed_size:
                return record.data
            stream, length = get_chunk_data_stream(record)
            return stream.read(length)
        except (McapError, struct.error, AssertionError, RuntimeError, ValueError) as error:
            raise FileFormatError(
                f"{self.path}: the chunk at byte {index.chunk_start_offset} is damaged ({type(error).__name__})"
            ) from None

    def chunk_entries(self, number: int, channel: int) -> tuple[IntArray, IntArray]:
        """Times and offsets of a channel's messages in one chunk, in the order in which they were written."""
        place = self.chunks[number].message_index_offsets.get(channel)
        if place is None:
            return np.empty(0, np.int64), np.empty(0, np.int64)
        self._stream.seek(place + 9 + 2)  # opcode, length, channel
        (length,) = struct.unpack("<I", self._stream.read(4))
        entries = np.frombuffer(self._stream.read(length), dtype=_INDEX_ENTRY)
        return entries["time"].astype(np.int64), entries["offset"].astype(np.int64)

    def entries(self, channel: int) -> Entries:
        """All messages of a channel, in the order of their times."""
        parts = [self.chunk_entries(number, channel) for number in range(len(self.chunks))]
        if not parts:
            return Entries(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0, np.int64))
        times = np.concatenate([times for times, _ in parts])
        offsets = np.concatenate([offsets for _, offsets in parts])
        chunks = np.repeat(np.arange(len(parts)), [len(times) for times, _ in parts])
        order = np.argsort(times, kind="stable")
        return Entries(times[order], chunks[order], offsets[order])

    def payload(self, number: int, offset: int) -> memoryview:
        """The message whose record starts at ``offset`` of a chunk."""
        data = self.chunk_data(number)
        (length,) = struct.unpack_from("<Q", data, offset + 1)
        return memoryview(data)[offset + MESSAGE_HEAD : offset + 9 + length]

    def in_time_order(self, channels: set[int]) -> Iterator[tuple[int, int, memoryview]]:
        """Time, channel and payload of every message; holds only the chunks that overlap in time."""
        pending: list[tuple[int, int, int, int, memoryview]] = []
        for number, chunk in enumerate(self.chunks):
            wanted = channels & set(chunk.message_index_offsets)
            if wanted:
                data = self.chunk_data(number)
                whole = memoryview(data)
                for channel in wanted:
                    times, offsets = self.chunk_entries(number, channel)
                    for time_ns, offset in zip(times.tolist(), offsets.tolist(), strict=True):
                        (length,) = struct.unpack_from("<Q", data, offset + 1)
                        payload = whole[offset + MESSAGE_HEAD : offset + 9 + length]
                        pending.append((time_ns, number, offset, channel, payload))
            last = number + 1 == len(self.chunks)
            limit = None if last else self.chunks[number + 1].message_start_time
            pending.sort(key=lambda entry: entry[:3])
            ready = len(pending)
            if limit is not None:
                ready = next((i for i, entry in enumerate(pending) if entry[0] >= limit), ready)
            for time_ns, _, _, channel, payload in pending[:ready]:
                yield time_ns, channel, payload
            del pending[:ready]
