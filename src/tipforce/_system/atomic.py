"""Files and folders that appear whole or not at all: written beside their place, renamed at the end.

Parent folders are made. An error in a ``with`` block removes the new file and leaves the old one. Only regular files
are replaced, never devices, pipes or folders; for a link, its target is replaced.
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
    """Turns an error of the operating system while ``path`` is written into an `OutputError` of one sentence.

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
    """Returns the name of a recording while it is being written; recovery finds it by this name."""
    return path.with_name(path.name + ".part")


def check_folder(path: Path) -> None:
    """Checks before any work whether a file can be written in the folder of ``path``, which is not made yet.

    Raises:
        OutputError: one of the parent folders is a file, or nothing can be written there.
    """
    there = next((parent for parent in path.absolute().parents if parent.exists()), None)
    if there is None:
        return
    if not there.is_dir():
        raise OutputError(f"{path}: {there} is a file, not a folder; choose another place")
    try:  # the permissions alone are not enough: the administrator has none to check, and /proc ignores them
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        why = REMEDIES.get(error.errno or 0, f"nothing can be written in {there}; choose another place")
        raise OutputError(f"{path}: cannot be written, {why}") from None


def check_output_file(path: Path) -> None:
    """Checks before any work whether a file can be written as ``path``.

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
    """Yields a new path beside ``path`` to write to; it gets the name ``path`` when the block ends without an error.

    It is for writers that open files themselves. Two processes cannot write the same ``path`` at the same time.

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
    """Yields a text file in UTF-8 that appears as ``path`` when the block ends; line ends are kept as they are."""
    with atomic_path(path) as part, part.open("w", encoding="utf-8", newline="") as stream:
        yield stream
        stream.flush()


def write_atomic(path: Path, data: bytes | str) -> None:
    """Writes a whole file.

    Args:
        path: the file.
        data: its content; text is written in UTF-8.

    Raises:
        OutputError: as `atomic_path` does.
    """
    with atomic_path(path) as part:
        part.write_bytes(data.encode() if isinstance(data, str) else data)


@contextmanager
def replacing_folder(folder: Path) -> Generator[Path]:
    """Yields a new folder to fill; it gets the name ``folder`` when the block ends, an error in the block removes it.

    An old folder of that name is removed after the new one has taken its place. The caller decides beforehand whether
    it may be removed.
    """
    check_folder(folder)
    with writing(folder), output_lock(folder):
        folder.parent.mkdir(parents=True, exist_ok=True)
        part = Path(tempfile.mkdtemp(prefix=f".{folder.name[:100]}.", suffix=".part", dir=folder.parent))
        try:
            yield part
            # mkdtemp gives access to the owner only
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
