"""Names, locks and leftovers of recording files."""

import importlib
import struct
from pathlib import Path
from typing import IO

from mcap.exceptions import McapError
from mcap.records import Metadata
from mcap.stream_reader import StreamReader

from ..errors import FileFormatError

__all__ = ["check_target", "finished_of", "lock", "origin_of", "part_of"]


def part_of(path: Path) -> Path:
    """What a file is called while it is being written."""
    return path.with_name(path.name + ".part")


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
        raise FileFormatError(
            f"{path}: is still being written by another process; open it when that has ended"
        ) from None


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
    """Raises FileFormatError where writing ``path`` would destroy something.

    The ``.part`` of an import may be replaced by another import: its sources are still there. That of a recording
    holds the only copy of a run.
    """
    if not path.parent.is_dir():
        raise FileFormatError(f"{path}: the folder {path.parent} does not exist; make it first")
    if path.exists() and not overwrite:
        raise FileFormatError(f"{path}: exists already; choose another name or state --overwrite")
    part = part_of(path)
    if part.exists() and not overwrite and not (origin == "import" == origin_of(part)) and part.stat().st_size:
        raise FileFormatError(
            f"{part}: holds a recording that was cut off; recover it with `tipforce inspect {path}` or remove it"
        )
