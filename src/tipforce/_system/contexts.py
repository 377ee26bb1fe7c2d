"""The end of a ``with`` block."""

from typing import Self


class ClosedAtExit:
    """A context manager that returns itself and calls `close` at the end of the block."""

    __slots__ = ()

    def close(self) -> None:
        """Releases what the object has opened; does nothing where nothing stays open."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
