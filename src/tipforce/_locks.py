"""One writer for each output: a second process is refused, and told which one is at work."""

import hashlib
import importlib
import os
import sys
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from .errors import OutputError

__all__ = ["output_lock"]

_held: set[str] = set()
"""Keys of the locks that this process holds: it may take them again."""


@contextmanager
def output_lock(path: Path) -> Generator[None]:
    """Holds the output ``path`` for this process until the block ends; the operating system lets go when it dies.

    The lock is a file in the folder for temporary files, so it leaves nothing beside the output and holds for the
    processes of one machine. On Windows, where a file that is being written can be neither renamed nor removed, it does
    nothing.

    Raises:
        OutputError: another process holds it.
    """
    fcntl, key = _fcntl(), hashlib.sha256(os.path.realpath(path).encode()).hexdigest()[:32]
    if fcntl is None or key in _held:
        yield
        return
    folder = Path(tempfile.gettempdir()) / f"tipforce-locks-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    with (folder / key).open("a+", encoding="utf-8") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            stream.seek(0)
            holder = stream.read().strip() or "another process"
            raise OutputError(
                f"{path}: is being written by {holder}; wait until it ends, or choose another name"
            ) from None
        stream.truncate(0)
        stream.write(f"process {os.getpid()} (tipforce {' '.join(sys.argv[1:])[:200]})")
        stream.flush()
        _held.add(key)
        try:
            yield
        finally:
            _held.discard(key)
            stream.truncate(0)


def _fcntl() -> ModuleType | None:
    try:
        return importlib.import_module("fcntl")
    except ModuleNotFoundError:
        return None
