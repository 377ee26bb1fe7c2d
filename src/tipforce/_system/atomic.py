"""Files and folders that appear whole or not at all: written beside their place, renamed at the end.

Parent folders are made. An error in a ``with`` block removes what was written and leaves what was there before. Only
regular files are replaced, never devices, pipes or folders; of a link, what it points to.
"""

import errno
import os
import shutil
import stat
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from ..errors import OutputError
from .locks import output_lock

REMEDIES = {
    errno.ENOSPC: "there is no space left on the device; make room or choose another place",
    errno.EDQUOT: "the quota is used up; make room or choose another place",
    errno.EACCES: "there is no permission to write there; choose another place",
    errno.EPERM: "there is no permission to write there; choose another place",
    errno.EROFS: "the file system can only be read; choose another place",
    errno.ENAMETOOLONG: "the name is too long; choose a shorter one",
    errno.EIO: "the device reports an error; choose another place",
    errno.EFBIG: "the file grows too large for the file system; choose another place",
}


@contextmanager
def writing(path: Path) -> Generator[None]:
    """Turns what the operating system refuses while ``path`` is written into one sentence.

    Raises:
        OutputError: the disk is full, permission is missing, and the like.
    """
    try:
        yield
    except OSError as error:
        if error.errno not in REMEDIES:
            raise
        raise OutputError(f"{path}: cannot be written, {REMEDIES[error.errno]}") from error


def part_of(path: Path) -> Path:
    """What a recording is called while it is being written; recovery finds it by this name."""
    return path.with_name(path.name + ".part")


def check_folder(path: Path) -> None:
    """Asks before any work whether a file can be written in the folder of ``path``, which is not made yet.

    Raises:
        OutputError: a file stands where a folder must, or nothing can be written there.
    """
    there = next((parent for parent in path.absolute().parents if parent.exists()), None)
    if there is None:
        return
    if not there.is_dir():
        raise OutputError(f"{path}: {there} is a file, not a folder; choose another place")
    try:  # permissions alone do not tell: not of the administrator, and not of /proc
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        why = REMEDIES.get(error.errno or 0, f"nothing can be written in {there}; choose another place")
        raise OutputError(f"{path}: cannot be written, {why}") from None


def check_output_file(path: Path) -> None:
    """Asks before any work whether a file can be written as ``path``.

    Raises:
        OutputError: it is a folder, a device, a pipe or a socket, or its folder cannot be made.
    """
    check_folder(path)
    try:
        mode = path.stat().st_mode
    except OSError as error:  # not there, or a link to nothing
        if error.errno == errno.ELOOP:
            raise OutputError(
                f"{path}: is a link that leads back to itself; remove it or choose another name"
            ) from None
        return
    if stat.S_ISDIR(mode):
        raise OutputError(f"{path}: is a folder; name a file")
    if not stat.S_ISREG(mode):
        raise OutputError(f"{path}: is no regular file, and is not replaced by one; choose another name")


@contextmanager
def atomic_path(path: Path) -> Generator[Path]:
    """A new path beside ``path`` to write to; it takes the name ``path`` when the block ends without an error.

    For writers that open files themselves. Two processes cannot write the same ``path`` at once.

    Raises:
        OutputError: as `check_output_file`, `output_lock` and `writing` do.
    """
    check_output_file(path)
    with writing(path), output_lock(path):
        target = path.resolve() if path.is_symlink() else path
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{target.name[:100]}.", suffix=".part", dir=target.parent)
        os.close(handle)
        part = Path(name)
        try:
            yield part
            part.chmod(target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~_umask())
            part.replace(target)
        finally:
            part.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


@contextmanager
def atomic_text(path: Path) -> Generator[TextIO]:
    """A text file in UTF-8, lines as they are written, that appears as ``path`` when the block ends."""
    with atomic_path(path) as part, part.open("w", encoding="utf-8", newline="") as stream:
        yield stream
        stream.flush()


def write_atomic(path: Path, data: bytes | str) -> None:
    """Writes a whole file; text in UTF-8. Raises OutputError as `atomic_path` does."""
    with atomic_path(path) as part:
        part.write_bytes(data.encode() if isinstance(data, str) else data)


@contextmanager
def replacing_folder(folder: Path) -> Generator[Path]:
    """A new folder to fill, that takes the name ``folder`` when the block ends; an error in the block removes it.

    What had that name before goes only when the new folder stands in its place. Whether it may go is the caller's
    question, to be asked before.
    """
    check_folder(folder)
    with writing(folder), output_lock(folder):
        folder.parent.mkdir(parents=True, exist_ok=True)
        part = Path(tempfile.mkdtemp(prefix=f".{folder.name[:100]}.", suffix=".part", dir=folder.parent))
        try:
            yield part
            # mkdtemp makes it for its owner's eyes only
            part.chmod(0o777 & ~_umask())
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
