"""The end of a ``with`` block."""

from typing import Self


class ClosedAtExit:
    """A context manager that returns itself and calls `close` at the end of the block."""

    __slots__ = ()

    def close(self) -> None:
        """Releases the files and connections of the object; does nothing if none is open."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
