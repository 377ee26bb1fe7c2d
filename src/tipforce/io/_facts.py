"""Metadata records of a recording: clock map, tare, inertia, session metadata.

Each fact is one metadata record of the file, and all its values are text.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Literal, TypeVar

import numpy as np

from .._system.json_files import parse_json
from ..errors import FileFormatError
from ..plausibility import ForcePlausibility
from ..types import BoolArray, FloatArray, IntArray, SessionInfo, frozen

SUBTRACTED_FORCE = "tipforce.zero"
"""Name of a metadata record, followed by a number. It holds a zero that the operator set: this force is subtracted from
the estimates of the recording from ``stamp_ns`` on until the next such record; a ``magnitude_n`` of 0 undoes it."""
_REMEDY = "import it again"
_T = TypeVar("_T")

_DIGITS = 7
"""Decimals of a fact in newtons or kilograms; the further ones are rounding errors of sums."""


@dataclass(frozen=True, slots=True)
class ClockMap:
    """Maps the clock of the force log to the clock of the camera.

    Camera time = force stamp + ``offset_ns`` + (``rate`` - 1) (force stamp - ``reference_ns``): ``rate`` is the true
    frame rate divided by that of the camera's stamps where the clock of the log is right.

    Attributes:
        offset_ns: added to the force stamp ``reference_ns``, ns.
        how: "estimated" from deflection and force; "stated" by a person; "none" where both are taken as one clock;
            "refused" where it could not be determined (``detail`` states the reason), so that the recording has no
            labels; "stage" where the deflection shows that camera and stage run on one clock, but the movement of the
            stage in the force gives the offset more precisely than the deflection does.
        stderr_ms: one standard error of the offset at ``reference_ns``, ms; NaN unless estimated.
        explained: share of the variance of the deflection that the force explains; NaN unless tried.
        detail: one line for the user.
        rate: see above.
        rate_stderr: one standard error of ``rate``; NaN unless estimated.
        reference_ns: the force stamp at which the offset holds, ns.
    """

    offset_ns: int = 0
    how: Literal["estimated", "stated", "stage", "none", "refused"] = "none"
    stderr_ms: float = math.nan
    explained: float = math.nan
    detail: str = ""
    rate: float = 1.0
    rate_stderr: float = math.nan
    reference_ns: int = 0

    @property
    def offset_ms(self) -> float:
        """Milliseconds to add to the force stamp ``reference_ns``."""
        return self.offset_ns * 1e-6

    def camera_ns(self, force_ns: IntArray) -> IntArray:
        """Maps (n,) stamps of the force log to (n,) stamps of the clock of the camera.

        >>> ClockMap(5_000_000, "stated", rate=0.8).camera_ns(np.array([0, 1_000_000_000])).tolist()
        [5000000, 805000000]
        """
        return force_ns + self.offset_ns + _stretched(force_ns - self.reference_ns, self.rate)

    def force_ns(self, camera_ns: IntArray) -> IntArray:
        """Inverts `camera_ns`."""
        moved = camera_ns - self.offset_ns
        return moved + _stretched(moved - self.reference_ns, 1.0 / self.rate)

    def record(self) -> dict[str, str]:
        """Returns the metadata record."""
        return _texts(self, "camera time = force stamp + offset_ns + (rate - 1) (force stamp - reference_ns)")

    @classmethod
    def of(cls, record: Mapping[str, str]) -> "ClockMap":
        """Inverts `record`; the rate of older recordings is 1. Raises ValueError."""
        return cls(**_values(cls, record, ("estimated", "stated", "stage", "refused")))


def _stretched(elapsed_ns: IntArray, rate: float) -> IntArray:
    """Returns the (n,) ns by which a clock of ``rate`` gains in ``elapsed_ns`` (n,)."""
    return np.rint(elapsed_ns * (rate - 1.0)).astype(np.int64) if rate != 1.0 else np.zeros_like(elapsed_ns)


def _zeros() -> FloatArray:
    return np.zeros(3)


@dataclass(frozen=True, slots=True, eq=False)
class Tare:
    """The reading of the sensor without contact, which is subtracted from every reading.

    Attributes:
        force_n: (3,) in the frame of the readings, N; 0 where the sensor has no such axis.
        stderr_n: (3,) one standard error of it, N; NaN where unknown.
        stretches_s: (start, end) of the stretches without contact, s on the clock of the force log since its first row.
        how: "stated", "detected" or "none" (nothing is subtracted).
        detail: one line for the user.
    """

    force_n: FloatArray = field(default_factory=_zeros)
    stderr_n: FloatArray = field(default_factory=lambda: np.full(3, math.nan))
    stretches_s: tuple[tuple[float, float], ...] = ()
    how: Literal["stated", "detected", "none"] = "none"
    detail: str = ""

    def __post_init__(self) -> None:
        for name, value in (("force_n", self.force_n), ("stderr_n", self.stderr_n)):
            object.__setattr__(self, name, frozen(name, np.round(np.asarray(value, np.float64), _DIGITS), (3,)))

    def covers(self, seconds: FloatArray) -> BoolArray:
        """Returns whether each time (n,), in s since the log's first row, is in a stretch without contact."""
        inside = np.zeros(len(seconds), np.bool_)
        for start, end in self.stretches_s:
            inside |= (seconds >= start) & (seconds <= end)
        return inside

    def record(self) -> dict[str, str]:
        """Returns the metadata record."""
        return _texts(self, "subtract force_n from every reading, before any rotation")

    @classmethod
    def of(cls, record: Mapping[str, str]) -> "Tare":
        """Inverts `record`. Raises ValueError, TypeError or FileFormatError."""
        values = _values(cls, record, ("stated", "detected"))
        stretches = tuple((float(start), float(end)) for start, end in values.pop("stretches_s", ()))
        return cls(**values, stretches_s=stretches)


@dataclass(frozen=True, slots=True, eq=False)
class Inertia:
    """The reading that a sensor on a moving stage gives because of the mass that it carries.

    It is subtracted from every reading. Stage stamp = force stamp + ``lag_ns`` + (``rate`` - 1) (force stamp -
    ``reference_ns``).

    Attributes:
        axes: names of the positions of the stage.
        gain_kg: (axes, 3) reading for each m/s^2, in the frame of the readings.
        lag_ns: see above, ns.
        how: "estimated" or "none" (nothing is subtracted).
        detail: one line for the user.
        rate: see above.
        reference_ns: see above, ns.
        beat_hz: fundamental frequency of the part that no log of the stage explains, Hz.
        beat_n: (harmonics, 2, 3) its cosines and sines, N, at ``beat_hz``, 2 ``beat_hz`` ... of the time since
            ``reference_ns``.
    """

    axes: tuple[str, ...] = ()
    gain_kg: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    lag_ns: int = 0
    how: Literal["estimated", "none"] = "none"
    detail: str = ""
    rate: float = 1.0
    reference_ns: int = 0
    beat_hz: float = 0.0
    beat_n: FloatArray = field(default_factory=lambda: np.zeros((0, 2, 3)))

    def __post_init__(self) -> None:
        object.__setattr__(self, "gain_kg", frozen("gain_kg", np.round(self.gain_kg, _DIGITS), (len(self.axes), 3)))
        object.__setattr__(self, "beat_n", frozen("beat_n", np.round(self.beat_n, _DIGITS), (None, 2, 3)))

    def stage_ns(self, force_ns: IntArray) -> IntArray:
        """Maps (n,) stamps of the force log to (n,) stamps of the clock of the stage."""
        return force_ns + self.lag_ns + _stretched(force_ns - self.reference_ns, self.rate)

    def record(self) -> dict[str, str]:
        """Returns the metadata record."""
        return _texts(
            self,
            "subtract the sum over axes of gain_kg x acceleration of the stage at force stamp + lag_ns + (rate - 1) "
            "(force stamp - reference_ns), and the sum over k of beat_n[k - 1] . (cos, sin)(2 pi k beat_hz (force "
            "stamp - reference_ns))",
        )

    @classmethod
    def of(cls, record: Mapping[str, str]) -> "Inertia":
        """Inverts `record`. Raises ValueError, TypeError or FileFormatError."""
        values = _values(cls, record, ("estimated",))
        axes = tuple(map(str, values.pop("axes", ())))
        gain_kg = np.array(values.pop("gain_kg", ()), np.float64).reshape(len(axes), 3)
        beat_n = np.array(values.pop("beat_n", ()), np.float64).reshape(-1, 2, 3)
        return cls(axes, gain_kg, beat_n=beat_n, **values)


def _texts(fact: "ClockMap | Inertia | Tare", meaning: str) -> dict[str, str]:
    """Returns the metadata record of a fact: each field as text, and the meaning of the record."""
    texts: dict[str, str] = {}
    for name in (each.name for each in fields(fact)):
        value = getattr(fact, name)
        if isinstance(value, str | int):
            texts[name] = str(value)
        elif isinstance(value, float):
            texts[name] = repr(float(value))
        else:
            texts[name] = json.dumps(value.tolist() if isinstance(value, np.ndarray) else value)
    return {**texts, "meaning": meaning}


def _values(kind: type, record: Mapping[str, str], hows: Sequence[str]) -> dict[str, Any]:
    """Returns the fields of a fact that a metadata record states.

    Args:
        kind: class of the fact.
        record: its metadata record; an older one lacks fields.
        hows: values of its field ``how``; another one becomes "none".

    Raises:
        ValueError, FileFormatError: a text is no value of its field.
    """
    values: dict[str, Any] = {}
    for attribute in fields(kind):
        text = record.get(attribute.name)
        if text is None:
            continue
        if isinstance(attribute.default, str):
            values[attribute.name] = text
        elif isinstance(attribute.default, int | float):
            values[attribute.name] = type(attribute.default)(text)
        else:
            values[attribute.name] = parse_json(text, attribute.name)
    values["how"] = values["how"] if values.get("how") in hows else "none"
    rate = values.get("rate", 1.0)
    if not (math.isfinite(rate) and rate > 0.0):
        raise ValueError(f"rate: expected a positive number, got {rate}")
    return values


Fact = ClockMap | ForcePlausibility | Inertia | Tare
"""A finding about a recording that its metadata hold."""

_RECORD_NAMES: dict[type, str] = {
    ClockMap: "tipforce.clock_offset",
    ForcePlausibility: "tipforce.plausibility",
    Inertia: "tipforce.inertia",
    Tare: "tipforce.tare",
}


def record_name(fact: Fact) -> str:
    """Returns the name of the metadata record that holds ``fact``.

    >>> record_name(Tare())
    'tipforce.tare'
    """
    return _RECORD_NAMES[type(fact)]


def session_record(info: SessionInfo) -> dict[str, str]:
    """Returns the metadata record that holds ``info`` as JSON, in the form of ``bench.toml``."""
    return {"json": json.dumps(info.values(), ensure_ascii=False)}


def session_from(record: Mapping[str, str], where: str) -> SessionInfo:
    """Inverts `session_record`.

    Args:
        record: the metadata record.
        where: the file, for the message.

    Returns:
        The session's metadata; nothing is known in it without a record.

    Raises:
        FileFormatError: the record is no JSON object.
        InputError: a value has another type or range.
    """
    if "json" not in record:
        return SessionInfo()
    values = parse_json(record["json"], f"{where}: session metadata", _REMEDY)
    if not isinstance(values, dict):
        raise FileFormatError(f"{where}: session metadata: expected an object with named values; {_REMEDY}")
    return SessionInfo.from_values(values, f"{where}: session metadata")  # pyright: ignore[reportUnknownArgumentType]


def fact_from(kind: Callable[[Mapping[str, str]], _T], record: Mapping[str, str], name: str, where: str) -> _T:
    """Reads a fact from a metadata record.

    Args:
        kind: makes the fact, such as `Tare.of`.
        record: the metadata record.
        name: its name, for the message.
        where: the file, for the message.

    Raises:
        FileFormatError: a value is missing or has another type or range.
    """
    try:
        return kind(record)
    except (ValueError, TypeError, OverflowError, FileFormatError) as error:
        raise FileFormatError(f"{where}: its metadata record {name} cannot be read ({error}); {_REMEDY}") from None
