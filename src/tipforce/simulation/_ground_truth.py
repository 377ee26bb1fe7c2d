"""The ground truth of a simulated session, and its companion file."""

import json
import zlib
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .._system.atomic import atomic_path
from .._system.json_files import parse_json
from .._system.npz import read_npz
from ..errors import FileFormatError
from ..geometry import Pose
from ..types import BasePose, BoolArray, FloatArray, IntArray
from ._bench import SimulatedBench
from ._fields import Settings

_SUFFIX = ".truth.npz"
_REMEDY = "delete it with its recording and run `tipforce simulate` again"
Bytes = npt.NDArray[np.uint8]


def _unpacked(packed: Bytes, ends: IntArray, index: int, size: tuple[int, int]) -> BoolArray:
    """Returns the ``index``-th mask (h, w) of all compressed masks, ``packed``; ``ends`` (n,): end of each in bytes.

    ``size``: (width, height). A decompressed mask has one bit a pixel.
    """
    width, height = size
    start, length = int(ends[index - 1]) if index else 0, -(-width * height // 8)
    try:
        bits = zlib.decompressobj().decompress(packed[start : int(ends[index])].tobytes(), length + 1)
    except zlib.error as error:
        raise FileFormatError(f"the mask of frame {index} of a truth is damaged ({error}); simulate it again") from None
    if len(bits) != length:
        raise FileFormatError(
            f"the mask of frame {index} of a truth has not the {width} x {height} pixels that the truth claims; "
            "simulate it again"
        )
    bits = np.frombuffer(bits, np.uint8)
    return np.unpackbits(bits, count=width * height).reshape(height, width).astype(np.bool_)


@dataclass(frozen=True, slots=True, eq=False)
class ViewTruth:
    """The ground truth of another view of the same instants. The fields have the meaning of those in `Truth`."""

    centreline_px: FloatArray
    visible: FloatArray
    mask_bytes: Bytes
    mask_ends: IntArray
    camera_from_base: Pose
    image_size: tuple[int, int]

    def mask(self, index: int) -> BoolArray:
        """Returns the mask (h, w) of frame ``index``: the catheter covers at least half of these pixels."""
        return _unpacked(self.mask_bytes, self.mask_ends, index, self.image_size)


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """The ground truth of a session, frame by frame: for evaluation and figures only, never for an estimator.

    The frames are numbered 0 to n - 1. Frames of reference: base, and camera (u, v, away from the camera).

    Attributes:
        session: name of the session.
        stamp_ns: (n,) middle of the exposure, camera clock.
        force_n: (n, 3) force of the tissue on the tip, base frame.
        touch_m: (n, 3) point of the tip at which it acts, base frame.
        touching: (n,) whether the tip touches the tissue.
        slipping: (n,) whether it slips there.
        centreline_m: (n, p, 3) base to tip, base frame, uniform in arc length.
        centreline_px: (n, p, 2) the same in the image.
        visible: (n,) visible share of the catheter.
        mask_bytes: the compressed masks, see `mask`.
        mask_ends: (n,) end of each mask in ``mask_bytes``.
        curvature_per_m: (n,) curvature of the unloaded shaft in its plane of bending.
        knob_deg: (n,) angle of the knob.
        camera_from_base: pose of the camera.
        sensor_from_base: pose of the force sensor.
        image_size: (width, height).
        clock_offset_s: camera time = (1 + ``clock_drift``) time in the force log + ``clock_offset_s``.
        clock_drift: see ``clock_offset_s``.
        values: the drawn parameters, by name with unit.
        settings: the settings from which they were drawn.
        side_force_n: (n, 3) force of the tissue on the side of the shaft, base frame; None if the side cannot touch.
        others: the views beyond the first, whose images show the same instants, or instants that are later by the
            ``view_delay_s`` of the settings. An image that was dropped in one view has its truth all the same.
    """

    session: str
    stamp_ns: IntArray
    force_n: FloatArray
    touch_m: FloatArray
    touching: BoolArray
    slipping: BoolArray
    centreline_m: FloatArray
    centreline_px: FloatArray
    visible: FloatArray
    mask_bytes: Bytes
    mask_ends: IntArray
    curvature_per_m: FloatArray
    knob_deg: FloatArray
    camera_from_base: Pose
    sensor_from_base: Pose
    image_size: tuple[int, int]
    clock_offset_s: float
    clock_drift: float
    values: Mapping[str, float]
    settings: Mapping[str, Any]
    side_force_n: FloatArray | None = None
    others: Mapping[str, ViewTruth] = field(default_factory=dict[str, ViewTruth])

    def base(self, index: int) -> BasePose:
        """Returns the base frame in the image of frame ``index``."""
        line = self.centreline_px[index]
        along = line[1] - line[0]
        return BasePose(line[0], float(np.arctan2(-along[1], along[0])))

    def mask(self, index: int) -> BoolArray:
        """Returns the mask (h, w) of frame ``index``: the catheter covers at least half of these pixels."""
        return _unpacked(self.mask_bytes, self.mask_ends, index, self.image_size)


def truth_path(recording: Path) -> Path:
    """Returns the path of the ground truth of ``recording`` (a file or a session's folder)."""
    return recording.with_name(recording.name.removesuffix(".mcap") + _SUFFIX)


def collect_truth(bench: SimulatedBench, frames: IntArray | None = None) -> Truth:
    """Collects the ground truth of ``bench`` at all frames, or at the indices ``frames`` (n,).

    Args:
        bench: the simulated session.
        frames: (n,) indices of frames; None: all.

    Returns:
        The ground truth of these frames.
    """
    chosen = np.arange(len(bench.frame_s)) if frames is None else frames
    log, times = bench.log, bench.frame_s[chosen]
    contact, trajectory, interpolator = bench.trajectory.contact, bench.trajectory, bench.interpolator
    first, *rest = (_view_truth(bench, view, chosen) for view in bench.views)
    nearest = interpolator.nearest(times)
    return Truth(
        session=bench.name,
        stamp_ns=bench.stamp_ns[chosen],
        force_n=interpolator.at(contact.force_n, times),
        touch_m=interpolator.at(contact.touch_m, times),
        touching=contact.touching[nearest],
        slipping=contact.slipping[nearest],
        centreline_m=interpolator.lines_m(times),
        centreline_px=first.centreline_px,
        visible=first.visible,
        mask_bytes=first.mask_bytes,
        mask_ends=first.mask_ends,
        curvature_per_m=interpolator.at(trajectory.curvature_per_m, times),
        knob_deg=interpolator.at(trajectory.knob_deg, times),
        camera_from_base=first.camera_from_base,
        sensor_from_base=Pose(log.rotation, np.zeros(3)),
        image_size=first.image_size,
        clock_offset_s=log.offset_s,
        clock_drift=log.drift,
        values=bench.values(),
        settings=settings_record(bench.preset_settings, bench.seed, bench.number),
        side_force_n=interpolator.at(contact.side_force_n, times)
        if contact.wall.side_stiffness_n_per_m2 > 0.0
        else None,
        others=dict(zip(bench.views[1:], rest, strict=True)),
    )


def _view_truth(bench: SimulatedBench, view: str, frames: IntArray) -> ViewTruth:
    """Collects the ground truth of one view at the indices ``frames`` (n,); each mask is compressed on its own."""
    images = [bench.image_truth(index, view) for index in frames.tolist()]
    compressed = [zlib.compress(np.packbits(image.mask).tobytes(), 1) for image in images]
    return ViewTruth(
        centreline_px=np.array([image.centreline_px for image in images]),
        visible=np.array([image.visible_share for image in images]),
        mask_bytes=np.frombuffer(b"".join(compressed), np.uint8),
        mask_ends=np.cumsum([len(mask) for mask in compressed]),
        camera_from_base=bench.imaging.camera(view).camera_from_world,
        image_size=(bench.settings.width, bench.settings.height),
    )


_POSES = ("camera_from_base", "sensor_from_base")
_ABOUT_FIELDS = ("session", "image_size", "clock_offset_s", "clock_drift", "values", "settings")


def _arrays(truth: Truth | ViewTruth) -> dict[str, npt.NDArray[Any]]:
    """Returns the fields of ``truth`` that the companion file keeps as arrays, by name.

    A pose becomes (3, 4): rotation, and translation in m. The fields of `_ABOUT_FIELDS` and the other views are left
    out: `write_truth` adds them.
    """
    arrays: dict[str, npt.NDArray[Any]] = {}
    for name in (each.name for each in fields(truth)):
        value = getattr(truth, name)
        if name in _POSES:
            arrays[name] = np.column_stack([value.rotation, value.translation_m])
        elif name not in _ABOUT_FIELDS and name != "others" and value is not None:
            arrays[name] = value
    return arrays


def write_truth(truth: Truth, path: Path) -> None:
    """Writes a ground truth to a file: the whole file or none.

    Args:
        truth: ground truth of all frames.
        path: path of the companion file.
    """
    about = {name: getattr(truth, name) for name in _ABOUT_FIELDS}
    if truth.others:
        about["others"] = list(truth.others)
    arrays = {"about": np.array(json.dumps(about)), **_arrays(truth)}
    for view, view_truth in truth.others.items():
        arrays |= {f"{view}.{name}": value for name, value in _arrays(view_truth).items()}
    with atomic_path(path) as part, part.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def _read_arrays(kind: type[Truth | ViewTruth], arrays: Mapping[str, npt.NDArray[Any]], prefix: str) -> dict[str, Any]:
    """Returns the fields of ``kind`` that are stored as arrays, by name: the inverse of `_arrays`.

    ``prefix``: prefix of the names in the file, such as "b." for the second view; a field with a default may be absent.
    """
    values: dict[str, Any] = {}
    for each in fields(kind):
        name = prefix + each.name
        if each.name in _POSES:
            matrix = arrays[name]
            values[each.name] = Pose(matrix[:, :3], matrix[:, 3])
        elif name in arrays or (each.name not in _ABOUT_FIELDS and each.default is MISSING and each.name != "others"):
            values[each.name] = arrays[name]
    return values


def read_truth(path: Path | str) -> Truth:
    """Reads the ground truth that ``tipforce simulate`` wrote, from its companion file's or the recording's path.

    Args:
        path: path of the companion file or of the recording.

    Returns:
        The ground truth of all frames.

    Raises:
        FileFormatError: the file does not exist or is not readable.
    """
    path = Path(path)
    path = path if path.name.endswith(_SUFFIX) else truth_path(path)
    if not path.is_file():
        raise FileFormatError(f"{path}: there is no such file; only recordings by `tipforce simulate` have a truth")
    try:
        arrays = read_npz(path, str(path), _REMEDY)
        values: dict[str, Any] = parse_json(str(arrays["about"]), str(path))
        size = tuple(values.pop("image_size"))
        others = {
            view: ViewTruth(image_size=size, **_read_arrays(ViewTruth, arrays, f"{view}."))
            for view in values.pop("others", ())
        }
        return Truth(image_size=size, others=others, **values, **_read_arrays(Truth, arrays, ""))
    except (AttributeError, LookupError, OSError, TypeError, ValueError) as error:
        raise FileFormatError(f"{path}: no readable truth ({error}); {_REMEDY}") from None


def settings_record(settings: Settings, seed: int, number: int) -> dict[str, Any]:
    """Returns the settings and random numbers of a session, as its ground truth keeps them.

    Args:
        settings: settings of the bench.
        seed: seed of all random numbers.
        number: number of the session, from 0.

    Returns:
        JSON values by name.
    """
    return {**settings.model_dump(mode="json"), "seed": seed, "number": number}
