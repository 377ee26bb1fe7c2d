"""Events -> observations: each picture with the actuation at its mid-exposure."""

from collections.abc import Iterable, Iterator

from ..types import Event, Observation

__all__ = ["observations"]


def observations(events: Iterable[Event], view: str = "camera", *, wait_s: float = 0.5) -> Iterator[Observation]:
    """An observation for each frame of ``view``.

    Actuation is interpolated linearly where a later reading comes within ``wait_s`` (in stamps) of the frame, else the
    last one holds; names without any reading so far are absent. A live loop passes ``wait_s=0``.
    """
    raise NotImplementedError
