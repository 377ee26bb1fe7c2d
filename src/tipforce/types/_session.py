"""Public metadata of a session: what ``bench.toml`` states, what a recording and a dataset carry, in SI units.

Every field is optional. A method declares those that it needs by their key, as `stated_keys` names them.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Interval

from ..errors import InputError
from ._arrays import FloatArray
from ._ranges import RANGES, actuation_range

BaseSide = Literal["left", "right", "top", "bottom"]
BASE_SIDES: tuple[BaseSide, ...] = ("left", "right", "top", "bottom")
_Pixel = Annotated[int, Interval(ge=-(1 << 62), le=1 << 62)]
Box = tuple[_Pixel, _Pixel, _Pixel, _Pixel]
"""(u0, v0, u1, v1) in pixels: left, top, right, bottom, the last two exclusive; it is clipped to the image."""

Reads = Literal["tip-on-tissue", "tissue-on-tip"]
"""Which of the two opposite forces at the contact a sensor shows."""

_STRICT: dict[str, Any] = {"extra": "forbid", "allow_inf_nan": False}


def _within(key: str) -> Interval:
    return Interval(ge=RANGES[key].low, le=RANGES[key].high)


@dataclass(frozen=True, slots=True)
class Catheter:
    """Nominal values of one catheter; None where nobody measured it. ``rigid_length_m`` is 0 without a rigid tip.

    ``_uncertainty``: relative standard uncertainty of the value of that name (GUM: a tolerance over the root of 3).
    ``stiffness_profile``: (share of the flexible length from the base, stiffness over the nominal one), for a shaft
    whose stiffness changes along its length.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = _STRICT

    name: str = "unnamed"
    diameter_m: Annotated[float, _within("diameter_m")] | None = None
    flexible_length_m: Annotated[float, _within("flexible_length_m")] | None = None
    rigid_length_m: Annotated[float, _within("rigid_length_m")] | None = None
    bending_stiffness_nm2: Annotated[float, _within("bending_stiffness_nm2")] | None = None
    stiffness_profile: tuple[tuple[float, float], ...] = ()
    flexible_length_uncertainty: Annotated[float, _within("flexible_length_uncertainty")] | None = None
    bending_stiffness_uncertainty: Annotated[float, _within("bending_stiffness_uncertainty")] | None = None


@dataclass(frozen=True, slots=True)
class ViewInfo:
    """One view. ``metres_per_px``: scale in the plane in which the catheter bends.

    ``metres_per_px_uncertainty``: its relative standard uncertainty; ``tilt_uncertainty_deg``: standard uncertainty of
    the angle between that plane and the image, about either of its axes.
    ``base_side``: the border of the image that the catheter comes from; ``base_region``: a box across the shaft where
    the base lies, for a catheter that does not reach the border; ``roi``: the part of the image to look at;
    ``polarity``: whether the catheter is darker or lighter than the ground. ``projection``: (3, 4), from metres in
    ``projection_frame`` to pixels; frame "isocentre": x to the patient's left, y to the back, z to the head.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = _STRICT

    metres_per_px: Annotated[float, _within("metres_per_px")] | None = None
    base_side: BaseSide | None = None
    base_region: Box | None = None
    roi: Box | None = None
    polarity: Literal["dark", "light"] | None = None
    modality: Literal["camera", "xray"] | None = None
    projection: tuple[tuple[float, float, float, float], ...] | None = None
    projection_frame: Literal["base", "isocentre"] | None = None
    metres_per_px_uncertainty: Annotated[float, _within("metres_per_px_uncertainty")] | None = None
    tilt_uncertainty_deg: Annotated[float, _within("tilt_uncertainty_deg")] | None = None


DateOrder = Literal["dmy", "mdy", "ymd"]
"""Order of day, month and year in a date of numbers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogInfo:
    """How the table of a log is written; None or empty: found in the file.

    ``time``: the column with the times; ``date``: the column with the dates, if the times are times of day.
    ``time_unit``: for times that are numbers; ``date_order``: for dates of numbers. ``rate_hz``: rows per second, for a
    log without times and for one whose clock is so coarse that many rows have the same stamp.
    ``columns``: the names of all columns, from left to right, for a log without a header row or with other names.
    ``decimal_sign``: the other of the two signs then groups the thousands. ``missing``: texts of cells without a
    reading. ``lines``: the first and the last line of the file that are read. ``sort``: rows that are not in the order
    of their stamps are sorted. ``repeated_stamps``: "first" keeps the first row of each stamp. ``sheet``: the sheet of
    a workbook.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = _STRICT

    time: str | None = None
    date: str | None = None
    time_unit: Literal["s", "ms", "us", "ns"] | None = None
    date_order: DateOrder | None = None
    rate_hz: Annotated[float, _within("rate_hz")] | None = None
    columns: tuple[str, ...] = ()
    decimal_sign: Literal[".", ","] | None = None
    missing: tuple[str, ...] = ()
    lines: tuple[int, int] | None = None
    sort: bool = False
    repeated_stamps: Literal["first"] | None = None
    sheet: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceLogInfo(LogInfo):
    """Which columns of a force log hold the axes, and their unit; None: found by the log's header.

    A leading "-" turns an axis round: ``fx="-Fy"``. ``status``: the column with the sensor's status code, where 0 means
    that all is well; empty: none is read. ``counts_per_n``: the sensor's sensitivity, for counts.
    """

    fx: str | None = None
    fy: str | None = None
    fz: str | None = None
    status: str | None = None
    force_unit: Literal["N", "kN", "cN", "mN", "kgf", "gf", "g", "lbf", "ozf", "counts"] | None = None
    counts_per_n: Annotated[float, _within("counts_per_n")] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class BagInfo:
    """Topics of a ROS bag, or of another program's MCAP; what is not stated: the only topic of its kind is taken.

    ``views``: view -> topic of images; ``force``: topic of the sensor's wrenches; ``drives`` and ``stage``: topics with
    the readings of the catheter's drives and of the stage (JointState, or one number), empty for none. ``names``:
    joint, or topic of numbers -> NAME_UNIT. ``receive_times``: topics whose messages are placed at the time at which
    they were received, because they have no stamp of their own or a wrong one.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = _STRICT

    views: Mapping[str, str] = field(default_factory=dict[str, str])
    force: str | None = None
    drives: tuple[str, ...] | None = None
    stage: tuple[str, ...] | None = None
    names: Mapping[str, str] = field(default_factory=dict[str, str])
    receive_times: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class StageInfo:
    """The stage that moves the tissue.

    ``log``: how its log is written. ``clock``: "camera" where that runs on the camera's clock.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = _STRICT

    log: LogInfo = LogInfo()
    clock: Literal["camera"] | None = None


_LargestReading = Annotated[float, _within("range_n")]


@dataclass(frozen=True, slots=True)
class SensorInfo:
    """The force sensor at the bench.

    ``angle_deg``: its x axis, counter-clockwise from the base x axis as seen in the displayed image; its z axis points
    to the camera. ``reads``: a sensor under the tissue reads tip-on-tissue. ``no_contact_s``: a stretch without
    contact, in seconds since its log's first row, which gives the tare. ``moving_mass_kg``: what moves with the sensor.
    ``range_n``: (3,) largest reading of fx, fy, fz by the data sheet; readings there are clipped. ``log``: how its log
    is to be read.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = _STRICT

    angle_deg: Annotated[float, _within("angle_deg")] | None = None
    reads: Reads | None = None
    no_contact_s: tuple[float, float] | None = None
    moving_mass_kg: Annotated[float, _within("moving_mass_kg")] | None = None
    range_n: tuple[_LargestReading, _LargestReading, _LargestReading] | None = None
    log: ForceLogInfo = ForceLogInfo()

    @property
    def matrix(self) -> FloatArray:
        """(3, 3): force of the tissue on the tip in the base frame = matrix @ (reading - tare).

        An angle that is not stated counts as 0, what the sensor reads as tip-on-tissue.

        >>> np.round(SensorInfo(angle_deg=90.0).matrix @ [1.0, 0.0, 0.0], 6) + 0.0
        array([ 0., -1.,  0.])
        """
        angle = math.radians(self.angle_deg or 0.0)
        c, s = math.cos(angle), math.sin(angle)
        sign = 1.0 if self.reads == "tissue-on-tip" else -1.0
        return sign * np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True)
class ActuationInfo:
    """The catheter's drives. ``knob_gain_per_m_deg``: curvature in 1/m that a degree of the knob asks for.

    ``knob_offset_per_m``: curvature with the knob at 0; ``knob_play_deg``: width of its hysteresis.
    ``knob_column``: column of the force log that holds the knob's angle, NAME_UNIT or else in degrees.
    ``constant``: readings that stayed the same all the time and are in no log, as ``{"knob_deg": 10.0}``; every name
    ends in its unit. ``log``: how the log of the drives is written.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = _STRICT

    knob_gain_per_m_deg: Annotated[float, _within("knob_gain_per_m_deg")] | None = None
    knob_column: str | None = None
    constant: Mapping[str, float] = field(default_factory=dict[str, float])
    knob_offset_per_m: Annotated[float, _within("knob_offset_per_m")] | None = None
    knob_play_deg: Annotated[float, _within("knob_play_deg")] | None = None
    log: LogInfo = LogInfo()

    def curvature_per_m(self, knob_deg: float) -> float | None:
        """Of the shaft without load, as the knob asks for it; None where no map of the knob is stated.

        >>> ActuationInfo(0.5, knob_offset_per_m=1.0).curvature_per_m(10.0)
        6.0
        """
        if self.knob_gain_per_m_deg is None or math.isnan(knob_deg):
            return None
        return (self.knob_offset_per_m or 0.0) + self.knob_gain_per_m_deg * knob_deg


@dataclass(frozen=True, slots=True)
class TissueInfo:
    """What the tip presses on. ``stiffness_n_per_m``: force over how deep the tip presses in, across the surface."""

    __pydantic_config__: ClassVar[dict[str, Any]] = _STRICT

    stiffness_n_per_m: Annotated[float, _within("stiffness_n_per_m")] | None = None


@dataclass(frozen=True, slots=True)
class SessionInfo:
    """What an estimator may know of a session beside its observations; never anything of the truth.

    ``name``: of the session; ``views``: by the name of the view; ``force_frame``: axes of the forces, "base" is the
    convention of this program; ``simulated`` and ``preset``: whether and by which preset it was simulated;
    ``remarks``: for people, read by nothing. ``stage`` and ``bag``: how the stage's log and a ROS bag are read.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = _STRICT

    name: str = ""
    catheter: Catheter = Catheter()
    views: Mapping[str, ViewInfo] = field(default_factory=dict[str, ViewInfo])
    sensor: SensorInfo = SensorInfo()
    actuation: ActuationInfo = ActuationInfo()
    tissue: TissueInfo = TissueInfo()
    force_frame: str = "base"
    simulated: bool = False
    preset: str | None = None
    remarks: str = ""
    stage: StageInfo = StageInfo()
    bag: BagInfo = BagInfo()

    def view(self, name: str) -> ViewInfo:
        """What is known of the view ``name``: nothing where it is not described."""
        return self.views.get(name, ViewInfo())

    def updated(self, stated: "SessionInfo") -> "SessionInfo":
        """These metadata with every value that ``stated`` holds in place of its own.

        >>> SessionInfo("a", Catheter("7F")).updated(SessionInfo(views={"camera": ViewInfo(2e-4)})).catheter.name
        '7F'
        """
        return SessionInfo.from_values(merged_values(self.values(), stated.values()))

    def values(self) -> dict[str, Any]:
        """Nested JSON values of all that is stated, as ``bench.toml`` has them.

        >>> SessionInfo(catheter=Catheter(diameter_m=2.33e-3)).values()
        {'catheter': {'diameter_m': 0.00233}}
        """
        return _adapter().dump_python(self, mode="json", exclude_defaults=True)

    @classmethod
    def from_values(cls, values: Mapping[str, Any], where: str = "the session's metadata") -> "SessionInfo":
        """The inverse of `values`.

        Args:
            values: nested, as ``bench.toml`` holds them.
            where: the file or option that they are from, for the message.

        Raises:
            InputError: a key is unknown, or a value is not what it has to be; the message names it.
        """
        from pydantic import ValidationError

        try:
            found = _adapter().validate_python(dict(values))
        except ValidationError as error:
            first = error.errors()[0]
            raise InputError(f"{where}: {_complaint(first['loc'], first)}") from None
        for name, value in found.actuation.constant.items():
            expected = actuation_range(name)
            if expected.outside(np.array([value])) is not None:
                raise InputError(
                    f"{where}: actuation.constant.{name} = {value:g} is refused: expected {expected}"
                    f"{expected.hint(value)}"
                )
        return found

    def stated_keys(self) -> tuple[str, ...]:
        """Keys of what is stated of catheter, views, sensor, actuation and tissue, as ``catheter.diameter_m``.

        How the stage's log and a bag are read is no property of the session and has no part in them.

        >>> SessionInfo(views={"camera": ViewInfo(base_side="left")}).stated_keys()
        ('views.camera.base_side',)
        """
        parts = {key: value for key, value in self.values().items() if isinstance(value, dict) and key not in _READING}
        return tuple(key for key in _flat(parts) if key != "catheter.name")

    def only(self, keys: Iterable[str]) -> "SessionInfo":
        """These metadata without what they state of catheter, views, sensor, actuation and tissue beyond ``keys``."""
        wanted = set(keys)
        values = self.values()
        for key in self.stated_keys():
            if key not in wanted:
                *path, last = key.split(".")
                inner = values
                for part in path:
                    inner = inner[part]
                del inner[last]
        return SessionInfo.from_values(values)

    def missing(self, keys: Iterable[str]) -> tuple[str, ...]:
        """Those of ``keys`` that are not stated."""
        stated = set(self.stated_keys())
        return tuple(key for key in keys if key not in stated)


def merged_values(values: Mapping[str, Any], stated: Mapping[str, Any]) -> dict[str, Any]:
    """Nested ``values``, with those of ``stated`` in their place."""
    made = dict(values)
    for key, value in stated.items():
        own = made.get(key)
        made[key] = merged_values(own, value) if isinstance(own, dict) and isinstance(value, dict) else value
    return made


def _flat(values: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in values.items():
        flat |= _flat(value, f"{before}{key}.") if isinstance(value, dict) else {f"{before}{key}": value}
    return flat


_ADAPTER: list[Any] = []


def _adapter() -> Any:
    """Pydantic's validator of `SessionInfo`; made at its first use, for the import of pydantic takes a while."""
    if not _ADAPTER:
        from pydantic import TypeAdapter

        _ADAPTER.append(TypeAdapter(SessionInfo))
    return _ADAPTER[0]


_READING = ("stage", "bag")
"""Sections that say how files are read."""

_PARTS: dict[str, type] = {
    "catheter": Catheter,
    "views": ViewInfo,
    "sensor": SensorInfo,
    "sensor.log": ForceLogInfo,
    "actuation": ActuationInfo,
    "actuation.log": LogInfo,
    "stage": StageInfo,
    "stage.log": LogInfo,
    "bag": BagInfo,
    "tissue": TissueInfo,
}


def _complaint(place: tuple[int | str, ...], error: Any) -> str:
    """One sentence on the first value that is refused."""
    names = [part for part in place if isinstance(part, str)]
    key = ".".join(names)
    if error["type"] == "unexpected_keyword_argument":
        before = ".".join(names[:-1])
        kind = _PARTS.get(before) or _PARTS.get(names[0] if before else "", SessionInfo)
        known = ", ".join(each.name for each in fields(kind))
        return f"{key} is not known; {before or 'it'} may hold {known}"
    value, expected = error["input"], RANGES.get(names[-1]) if names else None
    if expected and error["type"] in ("greater_than_equal", "less_than_equal"):
        return f"{key} = {value!r} is refused: expected {expected}{expected.hint(float(value))}"
    message = str(error["msg"])
    return f"{key} = {repr(value)[:200]} is refused: {message[0].lower()}{message[1:]}"
