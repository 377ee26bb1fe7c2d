"""Files and folders that appear whole or not at all: written beside their place, renamed at the end.

Parent folders are made. An error in a ``with`` block removes what was written and leaves what was there before.
"""

import shutil
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from ..errors import FileFormatError

__all__ = ["atomic_path", "atomic_text", "check_folder", "part_of", "replacing_folder", "write_atomic"]


def part_of(path: Path) -> Path:
    """What a file is called while it is being written."""
    return path.with_name(path.name + ".part")


def check_folder(path: Path) -> None:
    """Raises FileFormatError where ``path`` cannot be made, because a file stands where a folder must: ask first."""
    there = next((parent for parent in path.absolute().parents if parent.exists()), None)
    if there is not None and not there.is_dir():
        raise FileFormatError(f"{path}: {there} is a file, not a folder; choose another place")


@contextmanager
def atomic_path(path: Path) -> Generator[Path]:
    """A path beside ``path`` to write to; it takes the name ``path`` when the block ends without an error.

    For writers that open files themselves. Raises FileFormatError where the folder cannot be made.
    """
    check_folder(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = part_of(path)
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def atomic_text(path: Path) -> Generator[TextIO]:
    """A text file in UTF-8, lines as they are written, that appears as ``path`` when the block ends."""
    with atomic_path(path) as part, part.open("w", encoding="utf-8", newline="") as stream:
        yield stream
        stream.flush()


def write_atomic(path: Path, data: bytes | str) -> None:
    """Writes a whole file; text in UTF-8. Raises FileFormatError where its folder cannot be made."""
    with atomic_path(path) as part:
        part.write_bytes(data.encode() if isinstance(data, str) else data)


@contextmanager
def replacing_folder(folder: Path) -> Generator[Path]:
    """A new folder to fill, that takes the name ``folder`` when the block ends; an error in the block removes it.

    What had that name before goes only when the new folder stands in its place. Whether it may go is the caller's
    question, to be asked before.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    part = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=".part", dir=folder.parent))
    try:
        yield part
        # mkdtemp makes it for its owner's eyes only
        part.chmod(0o755)
        _swap(part, folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _swap(part: Path, folder: Path) -> None:
    if not folder.exists():
        part.replace(folder)
        return
    old = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=".old", dir=folder.parent))
    folder.replace(old / "old")
    try:
        part.replace(folder)
    except OSError:
        (old / "old").replace(folder)
        raise
    finally:
        shutil.rmtree(old, ignore_errors=True)
