"""Checksums that a dataset states for its own files, so that missing and damaged files are found when they are read.

The CRC-32 of each image file is in the column ``note_crc32`` (``note_VIEW_crc32``) of the table. The pages of Parquet
shards contain checksums; ``dataset.json`` states size and CRC-32 of each shard's footer, under ``files``.
"""

import re
import struct
import zlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import FileFormatError

_NUMBERED = re.compile(r"(.*)-(\d{5})-of-(\d{5})(\.parquet)$")
_FOOTER_END = struct.Struct("<I4s")
_REMEDY = "copy the dataset again from its source, or make it again"


def crc_column(view: str) -> str:
    """Returns the name of the column with the checksums of the images of ``view``; "" if there is only one view."""
    return f"note_{view}_crc32" if view else "note_crc32"


def crc_text(data: bytes) -> str:
    """Returns the CRC-32 of ``data`` as eight hexadecimal digits."""
    return f"{zlib.crc32(data):08x}"


def check_image(path: Path, stated: str) -> None:
    """Checks that an image file was not changed.

    Args:
        path: the file; one that does not exist is not checked.
        stated: its CRC-32 in the table, as `crc_text` writes it; "" is not checked.

    Raises:
        FileFormatError: the checksum differs.
    """
    if stated and path.is_file() and crc_text(path.read_bytes()) != stated:
        raise FileFormatError(
            f"{path}: is damaged or was changed (its CRC-32 is not the {stated} that the table states); {_REMEDY}"
        )


def shard_facts(paths: Iterable[Path]) -> dict[str, dict[str, Any]]:
    """Returns name -> size and checksum of each shard, as ``dataset.json`` states them."""
    return {path.name: {"bytes": path.stat().st_size, "footer_crc32": crc_text(_footer(path))} for path in paths}


def check_shards(paths: Sequence[Path], files: Mapping[str, Any], facts: str, *, whole: bool) -> None:
    """Compares shards with the stated sizes and checksums.

    Args:
        paths: paths of the shards.
        files: name -> stated size and checksum; empty if ``dataset.json`` states none.
        facts: path of ``dataset.json``, for messages.
        whole: whether these are all shards of their folder; missing shards are then found, also by the numbers in the
            names of the others.

    Raises:
        FileFormatError: a shard is missing, has another size or footer, or does not belong to the dataset.
    """
    present = {path.name: path for path in paths}
    expected = set(files)
    for name in present:
        if match := _NUMBERED.match(name):
            stem, _, count, suffix = match.groups()
            # one name more than there are shards shows that one is missing; a damaged count may be any number
            expected |= {f"{stem}-{k:05d}-of-{count}{suffix}" for k in range(min(int(count), len(present) + 1))}
    folder = paths[0].parent
    if whole and (missing := sorted(expected - set(present))):
        more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
        raise FileFormatError(f"{folder / missing[0]}{more}: the shard is missing; {_REMEDY}")
    for name, path in present.items():
        if name not in files:
            if files:
                raise FileFormatError(f"{path}: is not a shard that {facts} states; remove it from the folder")
            continue
        if files[name] != shard_facts([path])[name]:
            raise FileFormatError(
                f"{path}: is damaged, cut off or was changed (size or checksum are not those in {facts}); {_REMEDY}"
            )


def _footer(path: Path) -> bytes:
    """Returns the end of a Parquet file, which contains the positions of its parts; empty if there is none."""
    with path.open("rb") as stream:
        size = stream.seek(0, 2)
        if size < _FOOTER_END.size:
            return b""
        stream.seek(size - _FOOTER_END.size)
        length, _ = _FOOTER_END.unpack(stream.read())
        if length > size - _FOOTER_END.size:
            return b""
        stream.seek(size - _FOOTER_END.size - length)
        return stream.read()
