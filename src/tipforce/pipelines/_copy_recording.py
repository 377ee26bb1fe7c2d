"""A copy of a recording: of one that is damaged what is whole, of one whose clocks are unknown with the stated map."""

from pathlib import Path
from typing import Literal

from ..alignment import ClockChoice, OffsetChoice, stated_clock
from ..errors import InputError
from ..io import RecordingReader, recover_recording


def copy_recording(
    recording: Path | str,
    target: Path | str,
    *,
    offset_ms: OffsetChoice | Literal["start"] = "auto",
    rate: float | None = None,
    overwrite: bool = False,
) -> str:
    """Copies what is whole in ``recording`` to ``target``, with the clock map that is stated.

    Args:
        recording: a recording (.mcap), or what a crash left of one (.mcap.part); it stays as it is.
        target: the copy.
        offset_ms: camera clock minus force clock at the first reading of the force, or "none" for one clock; "auto":
            the map of ``recording``.
        rate: true over stated frame rate, together with ``offset_ms``.
        overwrite: replace a recording that is there already.

    Returns:
        One line on what was lost.

    Raises:
        FileFormatError: it is no recording, or nothing in it is whole.
        InputError: the statement of the clocks is incomplete.
    """
    recording, target = Path(recording), Path(target)
    if offset_ms == "auto":
        if rate is not None:
            raise InputError(f"{recording}: rate={rate:g} of a recording goes with its offset: state offset_ms=MS, too")
        return recover_recording(recording, target, overwrite=overwrite)
    if offset_ms == "start" or recording.suffix == ".part":
        raise InputError(
            f'{recording}: offset_ms="start" is for logs, and what a crash left is recovered first: import it without '
            "offset_ms, then state the offset of the copy"
        )
    with RecordingReader(recording) as reader:
        force = next((stream for stream in reader.info.streams.values() if stream.kind == "wrench"), None)
        if force is None:
            raise InputError(f"{recording}: holds no force, so there are no clocks to bring together")
        clock = stated_clock(ClockChoice(offset_ms, rate), force.first_ns)
    return recover_recording(recording, target, overwrite=overwrite, clock=clock)
