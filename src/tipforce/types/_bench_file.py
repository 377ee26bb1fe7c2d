"""``bench.toml``: the session metadata of a bench as a file that a person writes, with a comment for every value."""

import json
import math
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from .._system.json_files import check_depth, read_small_text, too_deep
from ..errors import FileFormatError, InputError
from ._session import SessionInfo, merged_values

_TABLE = (
    ("columns", '["time_s", "", "fx_n"]', "names of all columns, for a log without a header; empty: not read"),
    ("time", '"Time [s]"', "the column with the times"),
    ("date", '"Date"', "the column with the dates, if the times are times of day"),
    ("time_unit", '"s"', "s, ms, us or ns"),
    ("date_order", '"dmy"', "dmy for 31/12/2026, mdy for 12/31/2026, ymd for 2026/12/31"),
    ("rate_hz", "1000.0", "rows per second, for a log without times or with a coarse clock"),
    ("decimal_sign", '","', "the other one of , and . then groups thousands"),
    ("missing", '["---", "-9999"]', "texts of cells without a reading"),
    ("lines", "[2, 30000]", "first and last line that are read"),
    ("sort", "true", "rows that are not in the order of their stamps are sorted"),
    ("repeated_stamps", '"first"', "of the rows with one stamp the first is kept"),
    ("sheet", '"Sheet1"', "of a workbook"),
)
"""Keys of every log."""
_UNSHOWN = tuple((key, "", meaning) for key, _, meaning in _TABLE)
"""The same keys where they are shown for another log already."""

_GUIDE: dict[str, tuple[str, tuple[tuple[str, str, str], ...]]] = {
    "catheter": (
        "The catheter, by its data sheet or as measured. Lengths are in metres: 2.33 mm is 2.33e-3.",
        (
            ("name", '"7F ablation catheter"', ""),
            ("diameter_m", "2.33e-3", "outer diameter of the shaft"),
            ("flexible_length_m", "40e-3", "from the clamp or the sheath's mouth to the rigid tip"),
            ("rigid_length_m", "8e-3", "the electrode; 0 without a rigid tip"),
            ("bending_stiffness_nm2", "4.3e-4", "EI of the flexible part"),
            (
                "flexible_length_uncertainty",
                "0.01",
                "relative standard uncertainty: a tolerance of +-2 % is 0.02 / 1.73",
            ),
            ("bending_stiffness_uncertainty", "0.03", "the same of EI; the rod estimators' intervals rest on it"),
            (
                "stiffness_profile",
                "[[0.0, 1.0], [1.0, 0.5]]",
                "[share of the length, EI over the value above]; a step is two shares that are near",
            ),
            (
                "rest_curvature_per_m",
                "[3.0, 0.0, -3.0]",
                "of the flexible part without load, knob at 0, from base to tip; an arc where it is not stated",
            ),
        ),
    ),
    "views": (
        'One table for each view. A single camera is "camera".',
        (
            ("metres_per_px", "2.0e-4", "scale in the plane in which the catheter bends: 0.2 mm a pixel"),
            ("metres_per_px_uncertainty", "0.006", "relative standard uncertainty: +-1 % is 0.01 / 1.73"),
            ("tilt_uncertainty_deg", "1.2", "of the angle between image and plane of bending: +-2 degrees is 2 / 1.73"),
            ("base_side", '"left"', "border of the image that the catheter comes from: left, right, top, bottom"),
            ("base_region", "[100, 200, 140, 260]", "a box across the shaft at its base, px: left, top, right, bottom"),
            ("roi", "[0, 0, 640, 480]", "the part of the image to look at, px: left, top, right, bottom"),
            ("polarity", '"dark"', "the catheter is dark or light against the ground; found where it is not stated"),
            ("modality", '"camera"', "camera or xray"),
            ("projection", "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]", "3 x 4: metres to pixels"),
            ("projection_frame", '"base"', "base; isocentre: x to the patient's left, y back, z to the head; board"),
            ("pose_uncertainty_deg", "[1.0, 1.0, 0.5]", "of its turn about the image's right, down and depth"),
            ("pose_uncertainty_m", "[2e-3, 2e-3, 5e-3]", "of the position of the frame's origin along them"),
            ("detector", '"detector"', "folder that `tipforce annotate` wrote, beside this file"),
        ),
    ),
    "sensor": (
        "The force sensor, needed where labelled recordings are made.",
        (
            ("angle_deg", "90.0", "its x axis, counter-clockwise from the catheter's base, as seen in the image"),
            ("reads", '"tip-on-tissue"', "a sensor under the tissue; tissue-on-tip for one that holds the catheter"),
            ("no_contact_s", "[0.0, 5.0]", "without contact in every session, in seconds of the log: the tare"),
            ("moving_mass_kg", "0.05", "mass on a moving sensor"),
            (
                "range_n",
                "[3.0, 3.0, 9.0]",
                "largest readings of fx, fy, fz by the data sheet, N: beyond, they are clipped",
            ),
        ),
    ),
    "sensor.log": (
        "Format of the force log; values that are not stated are found in the file.",
        (
            *_TABLE,
            ("fx", '"Fx"', '"-Fx" turns the axis round'),
            ("fy", '"Fy"', ""),
            ("fz", '"Fz"', "toward the camera, if there is one"),
            ("status", '"Status (hex)"', "the sensor's status code, 0 for no fault"),
            ("force_unit", '"N"', "N, kN, cN, mN, kgf, gf (or g), lbf, ozf or counts"),
            ("counts_per_n", "1000.0", "for counts"),
        ),
    ),
    "actuation": (
        "The catheter's drives.",
        (
            ("knob_gain_per_m_deg", "0.533", "curvature in 1/m for a degree of the knob"),
            ("knob_gain_uncertainty", "0.012", "relative standard uncertainty: +-2 % is 0.02 / 1.73"),
            ("knob_offset_per_m", "0.1", "curvature in 1/m with the knob at 0"),
            ("knob_play_deg", "1.0", "hysteresis of the knob: it turns by this angle before the catheter follows"),
            ("knob_column", '"knob"', "column of the force log with the knob's angle in degrees"),
            ("constant", "{ knob_deg = 10.0 }", "readings that stay the same and are in no log; names end in the unit"),
        ),
    ),
    "actuation.log": ("Format of the log of the drives: the keys of sensor.log but force and status.", _UNSHOWN),
    "stage": (
        "The stage that moves the tissue.",
        (("clock", '"camera"', "its log runs on the camera's clock; otherwise the deflection matches the clocks"),),
    ),
    "stage.log": ("Format of the log of the stage: the same keys.", _UNSHOWN),
    "bag": (
        "Topics of a ROS bag or of another program's MCAP; the only topic of its kind needs no line.",
        (
            ("views", '{ camera = "/camera/image_raw/compressed" }', "Image or CompressedImage"),
            ("force", '"/ft_sensor/wrench"', "WrenchStamped"),
            ("drives", '["/joint_states"]', "of the catheter: JointState, Float64 or Float64Stamped"),
            ("stage", '["/stage/joint_states"]', "that moves the tissue: the same types"),
            ("names", '{ knob_joint = "knob_deg" }', "joint, or topic of numbers: its name, which ends in the unit"),
            ("receive_times", '["/knob/data"]', "topics whose messages have no stamp of their own"),
        ),
    ),
    "tissue": (
        "The tissue at the tip.",
        (("stiffness_n_per_m", "120.0", "force divided by the depth of the indentation"),),
    ),
}
"""Section -> its description; its keys, each with an example (empty: not shown in the guide) and its meaning."""

_MAX_BYTES = 1 << 20
_DEVICES = ("hardware",)
"""Tables that describe devices; the metadata of sessions do not contain them."""
_OTHERS = ("force_frame", "simulated", "preset", "remarks")


def bench_text(info: SessionInfo, *, guide: bool = True) -> str:
    """Writes metadata as the text of a ``bench.toml``.

    Args:
        info: the metadata; the name is left out, because a bench has many sessions.
        guide: whether values that are not stated are written as comments with an example.

    Returns:
        TOML; `read_bench` reads the same metadata from it.
    """
    values = info.values()
    lines = ["# The bench: a value is needed only where a command needs it. Units are in the names."]
    lines += [f"{key} = {toml_value(values[key])}" for key in _OTHERS if key in values]
    for section, (about, keys) in _GUIDE.items():
        stated: Any = values
        for part in section.split("."):
            stated = stated.get(part, {})
        # "views" has a table for each view, the other sections have one
        tables: Mapping[str | None, Any] = (stated or {"camera": {}}) if section == "views" else {None: stated}
        for name, table in tables.items():
            if not (table or guide):
                continue
            lines += ["", f"# {about}", f"[{section}]" if name is None else f"[{section}.{toml_key(name)}]"]
            for key, example, meaning in keys:
                note = f"  # {meaning}" if meaning and guide else ""
                if key in table:
                    lines.append(f"{key} = {toml_value(table[key])}{note}")
                elif guide and example:
                    lines.append(f"#{key} = {example}{note}")
    return "\n".join(lines) + "\n"


def read_bench(path: Path | str) -> SessionInfo:
    """Reads the metadata in the ``bench.toml`` at ``path``; `tipforce.hardware.read_devices` reads the devices in it.

    Raises:
        FileFormatError: there is no such file, or it is no TOML.
        InputError: a key is unknown or a value refused; the message names file, key and the expected value.
    """
    values = bench_values(path)
    info = SessionInfo.from_values({key: value for key, value in values.items() if key not in _DEVICES}, str(path))
    folder = Path(path).parent.absolute()
    views = {
        name: view if view.detector is None else replace(view, detector=str(folder / view.detector))
        for name, view in info.views.items()
    }
    return replace(info, views=views)


def bench_values(path: Path | str) -> dict[str, Any]:
    """Returns all values in the ``bench.toml`` at ``path`` as TOML has them. Raises FileFormatError."""
    path = Path(path)
    if path.is_dir():
        raise FileFormatError(f"{path}: is a folder; state the bench.toml in it")
    if not path.exists():
        raise FileFormatError(f"{path}: does not exist; write one with `tipforce init-bench -o {path}`")
    try:
        values = tomllib.loads(read_small_text(path, max_bytes=_MAX_BYTES))
    except RecursionError:
        raise too_deep(str(path)) from None
    except ValueError as error:  # no TOML, or a number of thousands of digits
        raise FileFormatError(f"{path}: is no TOML: {error}") from None
    check_depth(values, str(path))
    return values


def info_from_facts(facts: list[str]) -> SessionInfo:
    """Reads single values from texts ``KEY=VALUE`` with the keys of ``bench.toml``.

    Args:
        facts: for example ``["catheter.diameter_m=2.33e-3", "views.camera.base_side=left"]``.

    Raises:
        InputError: one of them has no ``=``, an unknown key or a value that is refused.

    >>> info_from_facts(["views.camera.base_side=left"]).view("camera").base_side
    'left'
    """
    values: dict[str, Any] = {}
    for fact in facts:
        key, equals, text = fact.partition("=")
        if not (key.strip() and equals and text.strip()):
            raise InputError(f"fact {fact}: expected KEY=VALUE, for example views.camera.base_side=left")
        try:
            value = tomllib.loads(f"value = {text}")["value"]
        except RecursionError:
            raise too_deep(f"fact {key.strip()}") from None
        except ValueError:  # no TOML: a text without quotes
            value = text.strip()
        nested: Any = value
        for part in reversed(key.strip().split(".")):
            nested = {part: nested}
        values = merged_values(values, nested)
    return SessionInfo.from_values(values, "fact " + ", ".join(facts))


def toml_key(name: str) -> str:
    """Returns ``name`` as a key of TOML."""
    return name if name.replace("_", "").replace("-", "").isalnum() and name.isascii() else _text(name)


def toml_value(value: Any) -> str:
    """Returns a JSON value in TOML."""
    if isinstance(value, dict):
        inner = ", ".join(f"{toml_key(key)} = {toml_value(each)}" for key, each in value.items())
        return f"{{ {inner} }}"
    if isinstance(value, list):
        return f"[{', '.join(toml_value(each) for each in value)}]"
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else "nan"
    return _text(value) if isinstance(value, str) else json.dumps(value)


def _text(value: str) -> str:
    """Returns a basic string of TOML: JSON, but with the control character DEL escaped."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
