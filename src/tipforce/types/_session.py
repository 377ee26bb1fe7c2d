"""Public metadata of a session, as ``bench.toml``, a recording and a dataset contain them, in SI units.

Every field is optional. A method declares the fields that it needs by their key, as `stated_keys` names them.
"""

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Interval, Len

from .._system.json_files import flat_values
from ..errors import InputError
from ._arrays import FloatArray
from ._ranges import RANGES, actuation_range

BaseSide = Literal["left", "right", "top", "bottom"]
BASE_SIDES: tuple[BaseSide, ...] = ("left", "right", "top", "bottom")
_Pixel = Annotated[int, Interval(ge=-(1 << 62), le=1 << 62)]
Box = tuple[_Pixel, _Pixel, _Pixel, _Pixel]
"""(u0, v0, u1, v1) in pixels: left, top, right, bottom, the last two exclusive; it is clipped to the image."""

Projection = tuple[
    tuple[float, float, float, float], tuple[float, float, float, float], tuple[float, float, float, float]
]
"""(3, 4) matrix from homogeneous metres to homogeneous pixels."""

Reads = Literal["tip-on-tissue", "tissue-on-tip"]
"""The force that a sensor shows, of the two opposite forces at the contact."""

_STRICT: dict[str, Any] = {"extra": "forbid", "allow_inf_nan": False}


def _within(key: str) -> Interval:
    return Interval(ge=RANGES[key].low, le=RANGES[key].high)


_Share = Annotated[float, Interval(ge=0.0, le=1.0)]
_StiffnessFactor = Annotated[float, Interval(ge=1e-3, le=1e3)]
_RestCurvature = Annotated[float, _within("rest_curvature_per_m")]


@dataclass(frozen=True, slots=True)
class Catheter:
    """Nominal values of one catheter; None where unknown.

    Attributes:
        name: name of the catheter.
        diameter_m: outer diameter of the shaft, m.
        flexible_length_m: from the clamp or the mouth of the sheath to the rigid tip, m.
        rigid_length_m: length of the rigid tip, m; 0 without one.
        bending_stiffness_nm2: EI of the flexible part, N m^2.
        stiffness_profile: (share of the flexible length from the base, stiffness divided by the nominal one), for a
            shaft whose stiffness changes along its length.
        flexible_length_uncertainty: relative standard uncertainty (GUM: a tolerance divided by the root of 3).
        bending_stiffness_uncertainty: relative standard uncertainty.
        rest_curvature_per_m: curvature of the flexible part without load and with the knob at 0, 1/m, at even distances
            from base to tip; positive: it turns counter-clockwise in the displayed image. Empty: an arc.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = _STRICT

    name: str = "unnamed"
    diameter_m: Annotated[float, _within("diameter_m")] | None = None
    flexible_length_m: Annotated[float, _within("flexible_length_m")] | None = None
    rigid_length_m: Annotated[float, _within("rigid_length_m")] | None = None
    bending_stiffness_nm2: Annotated[float, _within("bending_stiffness_nm2")] | None = None
    stiffness_profile: tuple[tuple[_Share, _StiffnessFactor], ...] = ()
    flexible_length_uncertainty: Annotated[float, _within("flexible_length_uncertainty")] | None = None
    bending_stiffness_uncertainty: Annotated[float, _within("bending_stiffness_uncertainty")] | None = None
    rest_curvature_per_m: Annotated[tuple[_RestCurvature, ...], Len(2, 1000)] = ()

    def stiffness_factors(self, joints: int) -> FloatArray:
        """Returns EI divided by its nominal value (joints,) at even distances from base to tip."""
        return _at_joints(self.stiffness_profile or ((0.0, 1.0),), joints)

    def rest_curvatures_per_m(self, joints: int) -> FloatArray:
        """Returns the curvature of the unloaded shaft (joints,) at even distances from base to tip, 1/m.

        >>> Catheter(rest_curvature_per_m=(4.0, 8.0)).rest_curvatures_per_m(3)
        array([4., 6., 8.])
        """
        values = self.rest_curvature_per_m or (0.0,)
        return _at_joints(tuple(zip(np.linspace(0.0, 1.0, len(values)).tolist(), values, strict=True)), joints)


def _at_joints(knots: tuple[tuple[float, float], ...], joints: int) -> FloatArray:
    """Returns values (joints,) at even distances from base to tip, linear between ``knots`` (share, value)."""
    shares, values = np.array(knots).T
    return np.interp(np.linspace(0.0, 1.0, joints), shares, values)


_TurnError = Annotated[float, _within("pose_uncertainty_deg")]
_ShiftError = Annotated[float, _within("pose_uncertainty_m")]


@dataclass(frozen=True, slots=True)
class ViewInfo:
    """Metadata of one view.

    Attributes:
        metres_per_px: scale in the plane in which the catheter bends, m.
        base_side: border of the image from which the catheter comes.
        base_region: box across the shaft at its base, for a catheter that does not reach the border.
        roi: part of the image that is searched.
        polarity: whether the catheter is darker or lighter than the ground.
        modality: kind of image.
        projection: (3, 4) matrix from metres in ``projection_frame`` to pixels.
        projection_frame: "base"; "isocentre": x to the patient's left, y to the back, z to the head; or "board": of a
            calibration board (origin in its middle, x right, y down, z ahead of the first view) or phantom.
        pose_uncertainty_deg: (3,) standard uncertainties of the view's turn about the origin of ``projection_frame``:
            about the image's right, its down and the viewing direction, degrees. 0 for the view of a pair to which the
            pose of the other one is relative.
        pose_uncertainty_m: (3,) standard uncertainties of this origin's position in the view along the same directions,
            m; the third is that of its distance, which changes the scale.
        metres_per_px_uncertainty: relative standard uncertainty of the scale.
        tilt_uncertainty_deg: standard uncertainty of the angle between plane of bending and image, about either of its
            axes, degrees.
        detector: folder of a locator that `tipforce annotate` fine-tuned on this bench.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = _STRICT

    metres_per_px: Annotated[float, _within("metres_per_px")] | None = None
    base_side: BaseSide | None = None
    base_region: Box | None = None
    roi: Box | None = None
    polarity: Literal["dark", "light"] | None = None
    modality: Literal["camera", "xray"] | None = None
    projection: Projection | None = None
    projection_frame: Literal["base", "isocentre", "board"] | None = None
    pose_uncertainty_deg: tuple[_TurnError, _TurnError, _TurnError] | None = None
    pose_uncertainty_m: tuple[_ShiftError, _ShiftError, _ShiftError] | None = None
    metres_per_px_uncertainty: Annotated[float, _within("metres_per_px_uncertainty")] | None = None
    tilt_uncertainty_deg: Annotated[float, _within("tilt_uncertainty_deg")] | None = None
    detector: str | None = None


DateOrder = Literal["dmy", "mdy", "ymd"]
"""Order of day, month and year in a date of numbers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogInfo:
    """Format of the table of a log; values that are None or empty are found in the file.

    Attributes:
        time: column with the times.
        date: column with the dates, if the times are times of day.
        time_unit: unit of times that are numbers.
        date_order: order of day, month and year in dates of numbers.
        rate_hz: rows per second, for a log without times or with a clock so coarse that rows have equal stamps.
        columns: names of all columns, from left to right, for a log without a header row or with other names.
        decimal_sign: decimal sign; the other of the two then groups the thousands.
        missing: texts of cells without a reading.
        lines: first and last line of the file that are read.
        sort: whether rows that are not in the order of their stamps are sorted.
        repeated_stamps: "first" keeps the first row of each stamp.
        sheet: sheet of a workbook.
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
    """Columns and unit of a force log; None: found by its header.

    Attributes:
        fx: column of the x axis; a leading "-" reverses the axis: ``fx="-Fy"``.
        fy: column of the y axis.
        fz: column of the z axis.
        status: column with the status code of the sensor, 0 for no fault; empty: none is read.
        force_unit: unit of the forces.
        counts_per_n: sensitivity of the sensor, for counts.
    """

    fx: str | None = None
    fy: str | None = None
    fz: str | None = None
    status: str | None = None
    force_unit: Literal["N", "kN", "cN", "mN", "kgf", "gf", "g", "lbf", "ozf", "counts"] | None = None
    counts_per_n: Annotated[float, _within("counts_per_n")] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class BagInfo:
    """Topics of a ROS bag, or of an MCAP file of another program; by default the only topic of its kind is taken.

    Attributes:
        views: view -> topic of images.
        force: topic of the sensor's wrenches.
        drives: topics with the readings of the catheter's drives (JointState, or one number); empty for none.
        stage: topics with the readings of the stage; empty for none.
        names: joint, or topic of numbers -> NAME_UNIT.
        receive_times: topics whose messages are placed at the time at which they were received, because they have no
            stamp of their own or a wrong one.
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

    Attributes:
        log: format of its log.
        clock: "camera" where its log runs on the clock of the camera.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = _STRICT

    log: LogInfo = LogInfo()
    clock: Literal["camera"] | None = None


_LargestReading = Annotated[float, _within("range_n")]


@dataclass(frozen=True, slots=True)
class SensorInfo:
    """The force sensor at the bench.

    Attributes:
        angle_deg: direction of its x axis, degrees counter-clockwise from the base x axis in the displayed image; its z
            axis points to the camera.
        reads: a sensor under the tissue reads tip-on-tissue.
        no_contact_s: start and end of a stretch without contact, s since the first row of its log, which gives the
            tare.
        moving_mass_kg: mass that moves with the sensor, kg.
        range_n: (3,) largest reading of fx, fy, fz by the data sheet, N; readings there are clipped.
        log: format of its log.
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

        If they are not stated, the angle counts as 0, and the reading as tip-on-tissue.

        >>> np.round(SensorInfo(angle_deg=90.0).matrix @ [1.0, 0.0, 0.0], 6) + 0.0
        array([ 0., -1.,  0.])
        """
        angle = math.radians(self.angle_deg or 0.0)
        c, s = math.cos(angle), math.sin(angle)
        sign = 1.0 if self.reads == "tissue-on-tip" else -1.0
        return sign * np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True)
class ActuationInfo:
    """The catheter's drives.

    Attributes:
        knob_gain_per_m_deg: curvature, 1/m, for a degree of the knob.
        knob_column: column of the force log with the knob's angle, NAME_UNIT or else in degrees.
        constant: readings that are constant and in no log, as ``{"knob_deg": 10.0}``; every name ends in its unit.
        knob_offset_per_m: curvature with the knob at 0, 1/m.
        knob_play_deg: width of the hysteresis of the knob, degrees.
        log: format of the log of the drives.
        knob_gain_uncertainty: relative standard uncertainty of the gain.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = _STRICT

    knob_gain_per_m_deg: Annotated[float, _within("knob_gain_per_m_deg")] | None = None
    knob_column: str | None = None
    constant: Mapping[str, float] = field(default_factory=dict[str, float])
    knob_offset_per_m: Annotated[float, _within("knob_offset_per_m")] | None = None
    knob_play_deg: Annotated[float, _within("knob_play_deg")] | None = None
    log: LogInfo = LogInfo()
    knob_gain_uncertainty: Annotated[float, _within("knob_gain_uncertainty")] | None = None

    def curvature_per_m(self, knob_deg: float) -> float | None:
        """Returns the curvature of the shaft without load for an angle of the knob; None where no gain is stated.

        >>> ActuationInfo(0.5, knob_offset_per_m=1.0).curvature_per_m(10.0)
        6.0
        """
        if self.knob_gain_per_m_deg is None or math.isnan(knob_deg):
            return None
        return (self.knob_offset_per_m or 0.0) + self.knob_gain_per_m_deg * knob_deg


@dataclass(frozen=True, slots=True)
class TissueInfo:
    """The tissue at the tip.

    Attributes:
        stiffness_n_per_m: force divided by depth of indentation, normal to the surface.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = _STRICT

    stiffness_n_per_m: Annotated[float, _within("stiffness_n_per_m")] | None = None


@dataclass(frozen=True, slots=True)
class SessionInfo:
    """Metadata of a session that an estimator may use; they contain no label.

    Attributes:
        name: name of the session.
        catheter: the catheter.
        views: name of the view -> its metadata.
        sensor: the force sensor.
        actuation: the catheter's drives.
        tissue: the tissue at the tip.
        force_frame: axes of the forces; "base" is the convention of this program.
        simulated: whether the session was simulated.
        preset: the preset by which it was simulated.
        remarks: for people; no program reads them.
        stage: format of the log of the stage.
        bag: topics of a ROS bag.
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
        """Returns the metadata of the view ``name``; all open where it is not described."""
        return self.views.get(name, ViewInfo())

    def updated(self, stated: "SessionInfo") -> "SessionInfo":
        """Returns these metadata with the values of ``stated`` in place of its own.

        >>> SessionInfo("a", Catheter("7F")).updated(SessionInfo(views={"camera": ViewInfo(2e-4)})).catheter.name
        '7F'
        """
        return SessionInfo.from_values(merged_values(self.values(), stated.values()))

    def values(self) -> dict[str, Any]:
        """Returns the stated values as nested JSON values, as ``bench.toml`` has them.

        >>> SessionInfo(catheter=Catheter(diameter_m=2.33e-3)).values()
        {'catheter': {'diameter_m': 0.00233}}
        """
        return _adapter().dump_python(self, mode="json", exclude_defaults=True)

    @classmethod
    def from_values(cls, values: Mapping[str, Any], where: str = "the session's metadata") -> "SessionInfo":
        """Makes the metadata from nested values, as the method `values` returns them.

        Args:
            values: nested, as ``bench.toml`` holds them.
            where: the file or option with the values, for the message.

        Raises:
            InputError: a key is unknown, or a value has a wrong type or range; the message names it.
        """
        from pydantic import ValidationError  # loaded late, so that `import tipforce` stays fast

        try:
            info = _adapter().validate_python(dict(values))
        except ValidationError as error:
            first = error.errors()[0]
            raise InputError(f"{where}: {_complaint(first['loc'], first)}") from None
        shares = [share for share, _ in info.catheter.stiffness_profile]
        if any(after <= before for before, after in itertools.pairwise(shares)):
            raise InputError(
                f"{where}: catheter.stiffness_profile is refused: expected shares of the length that grow from base to "
                f"tip, got {', '.join(f'{share:g}' for share in shares)}"
            )
        for name, value in info.actuation.constant.items():
            limits = actuation_range(name)
            if limits.outside(np.array([value])) is not None:
                raise InputError(
                    f"{where}: actuation.constant.{name} = {value:g} is refused: expected {limits}{limits.hint(value)}"
                )
        return info

    def stated_keys(self) -> tuple[str, ...]:
        """Returns the keys of the stated values, as ``catheter.diameter_m``, but for the name of the catheter.

        The formats of the stage's log and of a bag are no property of the session and are left out.

        >>> SessionInfo(views={"camera": ViewInfo(base_side="left")}).stated_keys()
        ('views.camera.base_side',)
        """
        parts = {
            key: value
            for key, value in self.values().items()
            if isinstance(value, dict) and key not in FILE_FORMAT_SECTIONS
        }
        return tuple(key for key in flat_values(parts) if key != "catheter.name")

    def only(self, keys: Iterable[str]) -> "SessionInfo":
        """Returns these metadata with only ``keys`` of the values of catheter, views, sensor, actuation and tissue."""
        kept_keys = set(keys)
        values = self.values()
        for key in self.stated_keys():
            if key not in kept_keys:
                *path, last = key.split(".")
                table = values
                for part in path:
                    table = table[part]
                del table[last]
        return SessionInfo.from_values(values)

    def missing(self, keys: Iterable[str]) -> tuple[str, ...]:
        """Returns those of ``keys`` that are not stated."""
        stated = set(self.stated_keys())
        return tuple(key for key in keys if key not in stated)


def merged_values(values: Mapping[str, Any], stated: Mapping[str, Any]) -> dict[str, Any]:
    """Merges nested values.

    Args:
        values: nested values.
        stated: nested values that replace those of ``values``, key by key.

    Returns:
        The merged values; the arguments are not changed.
    """
    merged = dict(values)
    for key, value in stated.items():
        old = merged.get(key)
        merged[key] = merged_values(old, value) if isinstance(old, dict) and isinstance(value, dict) else value
    return merged


_ADAPTER: list[Any] = []


def _adapter() -> Any:
    """Returns pydantic's validator of `SessionInfo`; made at its first use, because importing pydantic is slow."""
    if not _ADAPTER:
        from pydantic import TypeAdapter

        _ADAPTER.append(TypeAdapter(SessionInfo))
    return _ADAPTER[0]


FILE_FORMAT_SECTIONS = ("stage", "bag")
"""Sections that state how files are read."""

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
    """Returns one sentence on a value that is refused: its keys and indices, and the fault as pydantic describes it."""
    names = [part for part in place if isinstance(part, str)]
    key = ".".join(names)
    if error["type"] == "unexpected_keyword_argument":
        section = ".".join(names[:-1])
        kind = _PARTS.get(section) or _PARTS.get(names[0] if section else "", SessionInfo)
        known = ", ".join(each.name for each in fields(kind))
        return f"{key} is not known; {section or 'it'} may hold {known}"
    value, limits = error["input"], RANGES.get(names[-1]) if names else None
    if limits and error["type"] in ("greater_than_equal", "less_than_equal"):
        return f"{key} = {value!r} is refused: expected {limits}{limits.hint(float(value))}"
    message = str(error["msg"])
    return f"{key} = {repr(value)[:200]} is refused: {message[0].lower()}{message[1:]}"
