"""From shapes in space to the fluoroscope's image, and to the visible catheter in it."""

import math
import threading
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from numba import njit

from ....geometry import CameraModel, Pose
from ....types import BoolArray, FloatArray, IntArray
from .._exposure import sample_exposure
from ..camera import ImageTruth, TissueState
from ._collimator import open_field
from ._detector import (
    PhotonCounts,
    blurred,
    display_curve,
    frame_key,
    photon_tables,
    read_out,
    sample_photons,
    sum_with_lag,
)
from ._display_processing import Display, noise_gain, temporal_weights
from ._instruments import swayed
from ._light import BLOCK, ScatterAndGlare, direct_light, soft_layers
from ._patient_variety import shifted_still
from ._scene import XrayScene, lag_weights
from ._static_layers import make_static_layers
from ._tube_kernels import fold_instant, join_taken, no_spans
from ._variety import pan_m

FloatImage = npt.NDArray[np.float32]
GreyImage = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
_STEP_PX = 1.0
"""Motion blur is a mean of instants no farther apart than this: about the detector's own blur."""
_MOST_INSTANTS = 16
_FIELD = 0.33
"""Radius of the exposure control's measuring field, as a share of the image's side."""


@dataclass(frozen=True, slots=True, eq=False)
class Pulse:
    """Input of one image of `XrayRenderer.render`; see there."""

    shapes_m: FloatArray
    tissue: TissueState | None = None
    frame: int = 0
    time_s: float = 0.0

    def same(self, other: "Pulse") -> bool:
        """Returns whether both give the same light and noise."""
        if self is other:
            return True
        if (self.frame, self.time_s) != (other.frame, other.time_s) or (self.tissue is None) != (other.tissue is None):
            return False
        if not np.array_equal(self.shapes_m, other.shapes_m):
            return False
        if self.tissue is None or other.tissue is None:
            return True
        return np.array_equal(self.tissue.shift_m, other.tissue.shift_m)


@dataclass(slots=True, eq=False)
class _Buffers:
    """Buffers of one thread; ``drawn``, ``tube`` and ``taken`` are zero between uses. ``kept``: counts, newest last."""

    drawn: FloatImage
    tube: FloatImage
    taken: FloatImage
    light: FloatImage
    blocks: FloatImage
    spans: IntArray
    kept: list[tuple[Pulse, PhotonCounts]] = field(default_factory=list[tuple[Pulse, PhotonCounts]])

    @classmethod
    def of(cls, height: int, width: int) -> "_Buffers":
        a, b, c, d = np.zeros((4, height, width), np.float32)
        return cls(a, b, c, d, np.zeros((height // BLOCK, width // BLOCK), np.float32), no_spans(height))


class XrayRenderer:
    """Draws the images of one view of one session; several threads may call its methods at the same time.

    The same scene, shapes, frame number and ``before`` give the same bytes on any thread and in any order.

    Shapes are (m, n, 3): the catheter's axis from base to apex in the base frame, uniform in arc length, at instants
    evenly spread over the pulse, the first at its start and the last at its end; m = 1: nothing moves.

    Args:
        scene: the scene.
        length_m: length of the catheter, base to apex.
        view: number of the view.
        width: width of the image in px, a multiple of 8.
        height: height of the image in px, a multiple of 8.
        bits: bits of a grey level: 8 for uint8 images, 9 to 16 for uint16 images.

    Raises:
        ValueError: a side or the bits are outside of these values; or a varied scene has other than 8 bits.
    """

    def __init__(
        self, scene: XrayScene, length_m: float, *, view: int = 0, width: int = 512, height: int = 512, bits: int = 8
    ) -> None:
        """Paints all that does not move, and prepares detector, display and exposure control."""
        if width % BLOCK or height % BLOCK or not 8 <= bits <= 16:
            raise ValueError(
                f"an X-ray image: expected sides that are multiples of {BLOCK} and 8 to 16 bits, "
                f"got {width} x {height} and {bits} bits"
            )
        if scene.variety and bits != 8:
            raise ValueError(f"an X-ray image with the vendor's processing: expected 8 bits, got {bits}")
        self.scene, self.view, self.bits = scene, view, bits
        self._plane = scene.views[view]
        self._layers = make_static_layers(scene, view, length_m, width, height)
        self._weights = lag_weights(self._plane.detector)
        self._veil = ScatterAndGlare.of(self._plane.detector, self._layers.px_per_m, (height // BLOCK, width // BLOCK))
        self._tables = photon_tables()
        self._finer = width / 512.0
        self._photons = self._plane.beam.photons / self._finer**2  # smaller pixels get fewer photons
        self._electronic, self._display, self._clear = self._plane.detector.electronic, None, None
        if scene.variety:
            # The temporal filter averages frames: it lengthens the lag and lowers the electronic noise.
            kept, plane = scene.variety.processing.kept, self._plane
            self._weights = temporal_weights(self._weights, kept)
            self._electronic *= noise_gain(kept)
            open_pixels = open_field(scene.variety.collimators[view], height, width)
            self._display = Display(scene.variety.processing, open_pixels, plane.stated, plane.beam, scene.seed)
            self._clear = open_pixels & ~self._display.covered()
        self._curve = display_curve(self._plane.detector, self._photons, 16 if self._display else bits)
        self._thread_local = threading.local()
        self._field = self._measured()

    @property
    def camera(self) -> CameraModel:
        """How this view truly sees before the table or the C-arm moves; world = base frame."""
        return self._layers.camera

    @property
    def memory(self) -> int:
        """Number of earlier frames of which an image shows traces."""
        return len(self._weights) - 1

    def render(
        self,
        shapes_m: FloatArray,
        tissue: TissueState | None = None,
        *,
        frame: int = 0,
        time_s: float = 0.0,
        before: Sequence[Pulse] = (),
    ) -> GreyImage:
        """Draws the image of one X-ray pulse, with the lag of the pulses before it.

        Args:
            shapes_m: (m, n, 3) axis of the catheter in metres at m instants evenly spread over the pulse, base frame.
            tissue: position of the heart's wall, and with it of the heart's shadow; None: the heart beats in the rhythm
                of the scene.
            frame: number of the frame, from which the noise is drawn.
            time_s: time that determines the position of heart, breath and instruments.
            before: pulses before this one, newest last; only the last `memory` of them are visible. Those that this
                thread has drawn recently are taken from its memory.

        Returns:
            (h, w) image, uint8 or uint16 by the bits of the renderer.
        """
        now = Pulse(shapes_m, tissue, frame, time_s)
        earlier = list(before)[-self.memory :] if self.memory else []
        planes = [self._photon_counts(pulse) for pulse in (*earlier, now)][::-1]
        buffers, detector = self._buffers(), self._plane.detector
        sum_with_lag(planes, self._weights, buffers.light)
        signal = blurred(buffers.light, detector, self._finer)
        image: GreyImage
        sixteen_bits = self.bits > 8 or self._display is not None
        image = np.empty(signal.shape, np.uint16) if sixteen_bits else np.empty(signal.shape, np.uint8)
        key = frame_key(self.scene.seed, self.view, frame, 1)
        curve, gauss = self._curve, self._tables.gauss
        read_out(signal, key, gauss, self._electronic, detector.line_noise, curve.levels, curve.per_root, image)
        return self._display.apply(image, frame) if self._display else image

    def run(self, pulses: Iterable[Pulse]) -> Iterator[GreyImage]:
        """Yields the images of pulses that follow each other, each with the lag of those before it."""
        before: list[Pulse] = []
        for pulse in pulses:
            yield self.render(
                pulse.shapes_m, pulse.tissue, frame=pulse.frame, time_s=pulse.time_s, before=tuple(before)
            )
            before = [*before, pulse][-max(1, self.memory) :]

    def light(self, shapes_m: FloatArray, tissue: TissueState | None = None, *, time_s: float = 0.0) -> FloatImage:
        """Returns the photons that the detector expects of one pulse: before noise, blur and lag.

        Args:
            shapes_m: (m, n, 3) axis of the catheter.
            tissue: position of the heart's wall; None: the heart beats in the rhythm of the scene.
            time_s: time that determines the position of heart, breath and instruments.

        Returns:
            (h, w) photons.
        """
        buffers = self._buffers()
        self._expect(buffers, Pulse(shapes_m, tissue, 0, time_s))
        return buffers.light.copy()

    def truth(self, shapes_m: FloatArray, tissue: TissueState | None = None, *, time_s: float = 0.0) -> ImageTruth:
        """Returns the visible catheter in an image.

        Args:
            shapes_m: (m, n, 3) axis of the catheter.
            tissue: not used; no tissue hides the catheter.
            time_s: time that determines the position of the table.

        Returns:
            The truth at the middle of the pulse.
        """
        del tissue
        h, w = self._layers.still.shape
        camera, _ = self._cameras(time_s)
        points = sample_exposure(checked(shapes_m), 1)[0]
        return image_truth(camera, points, self.scene.catheter.radius_m, h, w, self._clear)

    def _photon_counts(self, pulse: Pulse) -> PhotonCounts:
        """Returns the photons of one pulse alone; they are kept for the frames after it."""
        buffers = self._buffers()
        for known, plane in buffers.kept:
            if known.same(pulse):
                return plane
        self._expect(buffers, pulse)
        plane = np.empty(buffers.light.shape, np.uint16)
        key = frame_key(self.scene.seed, self.view, pulse.frame, 0)
        sample_photons(buffers.light, key, self._tables.alias, self._tables.gauss, plane)
        buffers.kept = [*buffers.kept, (pulse, plane)][-(self.memory + 1) :]
        return plane

    def _expect(self, buffers: _Buffers, pulse: Pulse) -> None:
        """Computes the expected photons (h, w) of ``pulse`` in ``buffers.light``: before noise, blur and lag."""
        layers, rhythm = self._layers, self.scene.rhythm
        self._lay_tubes(buffers, pulse)
        breath = rhythm.breath(pulse.time_s)
        wall_px = None
        if pulse.tissue is not None:
            _, slopes = layers.camera.project_with_slopes(np.zeros((1, 3)))
            moved_px = slopes[0] @ pulse.tissue.shift_m.mean(axis=0)
            wall_px = float(moved_px[0]), float(moved_px[1])
        self._shine(buffers, breath, rhythm.beating(pulse.time_s), wall_px, pulse.time_s)
        buffers.taken[:] = 0.0
        # The exposure control keeps the mean of its measuring field, but it follows the breath late.
        breath_before = rhythm.breath(pulse.time_s - self._plane.beam.control_s)
        exposure = self._photons / float(np.interp(breath_before, np.linspace(0.0, 1.0, len(self._field)), self._field))
        self._veil.add(buffers.light, buffers.blocks, exposure)

    def _pan_m(self, time_s: float) -> FloatArray:
        """Returns the displacement (3,) of the patient relative to this plane, patient's frame."""
        return pan_m(self.scene.variety.pans[self.view] if self.scene.variety else (), time_s)

    def _cameras(self, time_s: float) -> tuple[CameraModel, CameraModel]:
        """Returns the camera models whose worlds are the base frame and the patient's frame, wherever the table is."""
        layers, table_m = self._layers, self._pan_m(time_s)
        if not table_m.any():
            return layers.camera, layers.patient_camera
        camera_from_patient = layers.patient_camera.camera_from_world @ Pose(np.eye(3), table_m)
        camera_from_base = camera_from_patient @ self.scene.patient_from_base
        return layers.camera.seen_from(camera_from_base), layers.patient_camera.seen_from(camera_from_patient)

    def _shine(
        self,
        buffers: _Buffers,
        breath: float,
        beating: float,
        wall_px: tuple[float, float] | None,
        time_s: float | None = None,
    ) -> None:
        """Computes in ``buffers.light`` the share of the rays that passes all layers and the tubes drawn before.

        ``breath``, ``beating``, ``wall_px``: see `soft_layers`. ``time_s``: time of the table and the contrast agent;
        None: before the table moves, and without contrast agent.
        """
        layers, variety = self._layers, self.scene.variety
        still, shift_px, contrast = layers.still, np.zeros(2), 0.0
        if layers.varied and variety:
            injection = variety.patient.injection
            if time_s is not None:
                shift_px = layers.varied.patient_px_per_m @ self._pan_m(time_s)
                contrast = injection.amount(time_s) if injection else 0.0
            still = shifted_still(layers.varied, layers.margin, shift_px, still.shape)
        soft_attenuation = soft_layers(layers, self.scene.rhythm, breath, beating, wall_px, shift_px, contrast)
        ribs_px = 0.15 * self.scene.rhythm.breath_m * breath * layers.head_px  # the ribs rise as the diaphragm sinks
        left, top = np.clip(layers.margin - ribs_px - shift_px, 0.0, 2.0 * layers.margin - 1.0).tolist()
        direct_light(still, layers.chest, left, top, soft_attenuation, buffers.taken, buffers.light, buffers.blocks)

    def _lay_tubes(self, buffers: _Buffers, pulse: Pulse) -> None:
        """Adds the absorption by catheter and devices during ``pulse`` to ``buffers.taken``, a mean over instants."""
        layers = self._layers
        base_camera, patient_camera = self._cameras(pulse.time_s)
        half_s = 0.3 * self._plane.beam.pulse_s  # two instants with nearly the same variance in time as the pulse
        instants = (pulse.time_s - half_s, pulse.time_s + half_s) if layers.varied else (pulse.time_s,)
        for time_s in instants:
            for item in layers.devices:
                points = swayed(item.instrument, item.points_m, item.share, self.scene.rhythm, time_s)
                item.tube.add(buffers.drawn, buffers.spans, patient_camera, points)
            fold_instant(buffers.drawn, buffers.spans, buffers.taken, 1.0 / len(instants))
        buffers.spans[:] = no_spans(len(buffers.spans))
        shapes = blur_instants(checked(pulse.shapes_m), layers.px_per_m)
        for points in shapes:
            layers.catheter.add(buffers.drawn, buffers.spans, base_camera, points)
            fold_instant(buffers.drawn, buffers.spans, buffers.tube, 1.0 / len(shapes))
        join_taken(buffers.tube, buffers.spans, buffers.taken)
        buffers.spans[:] = no_spans(len(buffers.spans))

    def _measured(self) -> FloatArray:
        """Returns the share (5,) of the rays that reaches the measuring field without the catheter, by the breath."""
        buffers = self._buffers()
        h, w = buffers.light.shape
        v, u = np.mgrid[0:h, 0:w]
        inside = np.hypot((v + 0.5) / h - 0.5, (u + 0.5) / w - 0.5) < _FIELD
        means: list[float] = []
        for breath in np.linspace(0.0, 1.0, 5):
            self._shine(buffers, float(breath), 0.0, None)
            self._veil.add(buffers.light, buffers.blocks, 1.0)
            means.append(float(buffers.light[inside].mean()))
        return np.array(means)

    def _buffers(self) -> _Buffers:
        buffers = getattr(self._thread_local, "buffers", None)
        if buffers is None:
            buffers = self._thread_local.buffers = _Buffers.of(*self._layers.still.shape)
        return buffers


def checked(shapes_m: FloatArray) -> FloatArray:
    """Returns the shapes as a contiguous array of 64-bit floats.

    Raises:
        ValueError: their shape is not (m, n, 3) with n > 2.
    """
    shapes = np.ascontiguousarray(shapes_m, np.float64)
    if shapes.ndim != 3 or shapes.shape[2] != 3 or shapes.shape[1] < 3 or not len(shapes):
        raise ValueError(f"shapes_m: expected shape (m, n, 3) with n > 2, got {shapes.shape}")
    return shapes


def blur_instants(shapes: FloatArray, px_per_m: float) -> FloatArray:
    """Interpolates a moving shape at as many instants as motion blur needs.

    Args:
        shapes: (m, n, 3) axis of the catheter in metres.
        px_per_m: scale of the image.

    Returns:
        (k, n, 3) axis at k instants, see `sample_exposure`.
    """
    distance_px = float(np.abs(np.diff(shapes, axis=0)).max(axis=(1, 2), initial=0.0).sum()) * px_per_m
    return sample_exposure(shapes, max(1, min(_MOST_INSTANTS, math.ceil(distance_px / _STEP_PX))))


@njit(cache=True, error_model="numpy", nogil=True)
def _cover(mask: BoolArray, pixels: FloatArray, half_px: FloatArray) -> None:
    """Marks the pixels of ``mask`` (h, w) within a band about the polyline ``pixels`` (n, 2).

    ``half_px`` (n,): half the width of the band at each point; in between it is linear.
    """
    h, w = mask.shape
    for i in range(pixels.shape[0] - 1):
        au, av, bu, bv = pixels[i, 0], pixels[i, 1], pixels[i + 1, 0], pixels[i + 1, 1]
        reach_px = max(half_px[i], half_px[i + 1])
        du, dv = bu - au, bv - av
        square_length = du * du + dv * dv
        for v in range(max(0, math.ceil(min(av, bv) - reach_px)), min(h, math.floor(max(av, bv) + reach_px) + 1)):
            for u in range(max(0, math.ceil(min(au, bu) - reach_px)), min(w, math.floor(max(au, bu) + reach_px) + 1)):
                share = ((u - au) * du + (v - av) * dv) / square_length if square_length > 0 else 0.0
                share = min(max(share, 0.0), 1.0)
                half = half_px[i] + share * (half_px[i + 1] - half_px[i])
                if (u - au - share * du) ** 2 + (v - av - share * dv) ** 2 <= half * half:
                    mask[v, u] = True


def _covered(camera: CameraModel, points_m: FloatArray, radius_m: float, height: int, width: int) -> BoolArray:
    """Returns the pixels (h, w) whose ray passes through a tube with a domed end.

    ``points_m`` (n, 3): its axis in the camera's world up to the apex of the dome; ``radius_m``: of tube and dome.
    """
    steps_m = np.linalg.norm(np.diff(points_m, axis=0), axis=1)
    arc_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    # The middle of the dome is one radius before its apex.
    even_arc_m = np.linspace(0.0, max(arc_m[-1] - radius_m, 0.0), 2 * len(arc_m))
    axis_m = np.stack([np.interp(even_arc_m, arc_m, points_m[:, k]) for k in range(3)], axis=1)
    depth = camera.camera_from_world.apply(axis_m)[:, 2]
    mask = np.zeros((height, width), np.bool_)
    pixels = camera.project(axis_m)
    if np.isfinite(pixels).all():
        _cover(mask, pixels, radius_m * float(camera.focal_px[1]) / depth)
    return mask


def image_truth(
    camera: CameraModel, points_m: FloatArray, radius_m: float, height: int, width: int, clear: BoolArray | None = None
) -> ImageTruth:
    """Returns the truth of an image of a catheter.

    No object hides another from X-rays: every point in the open field is visible, however faint it may be.

    Args:
        camera: camera of the view.
        points_m: (n, 3) axis of the catheter, in the camera's world.
        radius_m: radius of the catheter.
        height: height of the image in px.
        width: width of the image in px.
        clear: (h, w) pixels that neither the collimator nor the display covers; None: all.

    Returns:
        The truth.
    """
    centreline = camera.project(points_m)
    nearest_px = np.rint(np.nan_to_num(centreline, nan=-9.0))
    visible = np.asarray(((nearest_px >= 0) & (nearest_px < (width, height))).all(axis=1), np.bool_)
    weight = np.ones(len(visible))
    weight[[0, -1]] = 0.5
    mask = _covered(camera, points_m, radius_m, height, width)
    if clear is not None:
        mask &= clear
        u, v = np.where(visible[:, None], nearest_px, 0.0).astype(np.int64).T
        visible = visible & clear[v, u]
    return ImageTruth(mask, centreline, visible, float(visible @ weight / weight.sum()))
