"""A copy of a recording: the whole parts of a damaged one, or with a stated clock map or tare."""

from pathlib import Path
from typing import Literal

from ..alignment import ClockChoice, OffsetChoice, TareChoice, stated_clock
from ..errors import InputError
from ..io import Fact, RecordingReader, recover_recording
from ..types import Event, SensorInfo
from ..vision import VisionSettings
from ._record import write_run


def copy_recording(
    recording: Path | str,
    target: Path | str,
    *,
    offset_ms: OffsetChoice | Literal["start"] = "auto",
    rate: float | None = None,
    tare: TareChoice = "auto",
    overwrite: bool = False,
) -> list[str]:
    """Copies the whole parts of ``recording`` to ``target``, with the stated clock map and tare.

    Args:
        recording: a recording (.mcap), or the rest of one after a crash (.mcap.part); it is not changed.
        target: the copy.
        offset_ms: camera clock minus force clock at the first reading of the force, or "none" for one clock; "auto":
            the map of ``recording``, which is found anew where ``tare`` is stated.
        rate: true over stated frame rate, together with ``offset_ms``.
        tare: "auto": the one of ``recording``; "none"; or (start, end) in seconds of its force. Clock map, inertia and
            implausible readings are then found anew.
        overwrite: replace a recording that is there already.

    Returns:
        One line on the lost and the found parts.

    Raises:
        FileFormatError: it is no recording, or nothing in it is whole.
        InputError: the statement of the clocks is incomplete, or the tare does not fit the force.
    """
    recording, target = Path(recording), Path(target)
    if offset_ms == "auto" and rate is not None:
        raise InputError(f"{recording}: rate={rate:g} of a recording goes with its offset: state offset_ms=MS, too")
    if offset_ms == "auto" and tare == "auto":
        return [recover_recording(recording, target, overwrite=overwrite)]
    if offset_ms == "start" or recording.suffix == ".part":
        raise InputError(
            f'{recording}: offset_ms="start" is for logs, a crashed recording is recovered first: import it without '
            "offset_ms and tare, then state them for the copy"
        )
    with RecordingReader(recording) as reader:
        force = next((stream for stream in reader.info.streams.values() if stream.kind == "wrench"), None)
        if force is None:
            raise InputError(f"{recording}: holds no force, so there is no clock map and no tare")
        if tare == "auto":
            clock = stated_clock(ClockChoice(offset_ms, rate), force.first_ns)
            return [recover_recording(recording, target, overwrite=overwrite, facts=[clock] if clock else [])]
        if reader.info.metadata.get("tipforce.session", {}).get("origin") == "import":
            raise InputError(f"{recording}: was imported; import its files again with the tare")
        findings = _Findings()
        remarks = write_run(
            findings, reader, reader.session_info, None, tare, ClockChoice(offset_ms, rate), VisionSettings(), None
        )
    return [recover_recording(recording, target, overwrite=overwrite, facts=findings.facts), *remarks]


class _Findings:
    """Keeps the findings of a run; its events are in the recording already."""

    def __init__(self) -> None:
        self.facts: list[Fact] = []

    def write(self, event: Event) -> None:
        """Does nothing: the event is copied as it is."""

    def state(self, fact: Fact | SensorInfo) -> None:
        """Keeps the fact; the sensor's pose is in the recording already."""
        if not isinstance(fact, SensorInfo):
            self.facts.append(fact)
