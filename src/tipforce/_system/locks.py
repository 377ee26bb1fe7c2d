"""One writer for each output: a second process is refused, and the message names the first one."""

import contextlib
import hashlib
import importlib
import os
import sys
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from ..errors import OutputError

_held: set[str] = set()
"""Keys of the locks that this process holds; it may take them again."""


@contextmanager
def output_lock(path: Path) -> Generator[None]:
    """Holds the output ``path`` for this process until the block ends; the operating system frees it if it dies.

    The lock is a file in the folder for temporary files, so it leaves nothing beside the output and is valid for the
    processes of one machine. On Windows, where a file that is being written can be neither renamed nor removed, it has
    no effect.

    Raises:
        OutputError: another process holds the output.
    """
    fcntl, key = _fcntl(), _key(path)
    if fcntl is None or key in _held:
        yield
        return
    folder = _folder()
    folder.mkdir(mode=0o700, exist_ok=True)
    with (folder / key).open("a+b", buffering=0) as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OutputError(
                f"{path}: is being written by {_named(folder / key)}; wait until it ends, or choose another name"
            ) from None
        stream.truncate(0)
        with contextlib.suppress(OSError):  # on a full disk the lock holds, too, but without a name
            stream.write(f"process {os.getpid()} (tipforce {' '.join(sys.argv[1:])[:200]})".encode())
        _held.add(key)
        try:
            yield
        finally:
            _held.discard(key)
            stream.truncate(0)


def lock_holder(path: Path) -> str:
    """Returns the holder of the output ``path`` for a message; empty where nobody holds it."""
    fcntl, key = _fcntl(), _key(path)
    if key in _held:
        return "this process"
    file = _folder() / key
    if fcntl is None or not file.exists():
        return ""
    with file.open("rb") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return _named(file)
    return ""


def _named(file: Path) -> str:
    return file.read_text(encoding="utf-8").strip() or "another process"


def _key(path: Path) -> str:
    return hashlib.sha256(os.path.realpath(path).encode()).hexdigest()[:32]


def _folder() -> Path:
    return Path(tempfile.gettempdir()) / f"tipforce-locks-{os.getuid()}"


def _fcntl() -> ModuleType | None:
    try:
        return importlib.import_module("fcntl")
    except ModuleNotFoundError:
        return None
