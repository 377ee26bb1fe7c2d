"""From shapes in space to the fluoroscope's picture."""

import math
import threading
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ....geometry import CameraModel
from ....types import FloatArray, IntArray
from ..camera import PictureTruth, TissueState
from ..camera._project import instants
from ._light import BLOCK, Veil, direct_light, soft_layers
from ._makes import swayed
from ._paint import paint
from ._quanta import Quanta, draw_quanta, frame_key, quantum_tables
from ._readout import blurred, display_curve, read_out, with_lag
from ._scene import XrayScene, lag_weights
from ._truth import picture_truth
from ._tube import fold_instant, join_taken, no_spans

__all__ = ["Pulse", "XrayRenderer"]

Picture = npt.NDArray[np.float32]
Picture8Or16 = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

_STEP_PX = 1.0
"""Motion blur is a mean of instants no farther apart than this: about the detector's own blur."""
_MOST_INSTANTS = 16
_FIELD = 0.33
"""Radius of the exposure control's measuring field, as a share of the picture's side."""


@dataclass(frozen=True, slots=True, eq=False)
class Pulse:
    """What `XrayRenderer.render` draws one picture of; see there."""

    shapes_m: FloatArray
    tissue: TissueState | None = None
    frame: int = 0
    time_s: float = 0.0

    def same(self, other: "Pulse") -> bool:
        """Whether both give the same light and noise."""
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
class _Desk:
    """Buffers of one thread; ``drawn``, ``tube`` and ``taken`` are zero between uses. ``kept``: quanta, newest last."""

    drawn: Picture
    tube: Picture
    taken: Picture
    light: Picture
    blocks: Picture
    spans: IntArray
    kept: list[tuple[Pulse, Quanta]] = field(default_factory=list[tuple[Pulse, Quanta]])

    @classmethod
    def of(cls, height: int, width: int) -> "_Desk":
        a, b, c, d = np.zeros((4, height, width), np.float32)
        return cls(a, b, c, d, np.zeros((height // BLOCK, width // BLOCK), np.float32), no_spans(height))


class XrayRenderer:
    """Draws the pictures of one view of one session; its methods may be called from several threads at once.

    ``length_m``: of the catheter, base to apex. ``bits``: 8 gives uint8 pictures, 9 to 16 give uint16 ones. The same
    scene, shapes, frame number and ``before`` give the same bytes on any thread and in any order.

    Shapes are (m, n, 3): the catheter's axis from base to apex in the base frame, uniform in arc length, at instants
    evenly spread over the pulse, the first at its start and the last at its end; m = 1: nothing moves.

    Raises ValueError where the picture's sides are no multiples of 8 or ``bits`` is out of range.
    """

    def __init__(
        self,
        scene: XrayScene,
        length_m: float,
        *,
        view: int = 0,
        width: int = 512,
        height: int = 512,
        bits: int = 8,
    ) -> None:
        if width % BLOCK or height % BLOCK or not 8 <= bits <= 16:
            raise ValueError(
                f"an X-ray picture: expected sides that are multiples of {BLOCK} and 8 to 16 bits, "
                f"got {width} x {height} and {bits} bits"
            )
        self.scene, self.view, self.bits = scene, view, bits
        self._plane = scene.views[view]
        self._painted = paint(scene, view, length_m, width, height)
        self._weights = lag_weights(self._plane.detector)
        self._veil = Veil.of(self._plane.detector, self._painted.px_per_m, (height // BLOCK, width // BLOCK))
        self._tables = quantum_tables()
        self._finer = width / 512.0
        self._photons = self._plane.beam.photons / self._finer**2
        self._curve = display_curve(self._plane.detector, self._photons, bits)
        self._desks = threading.local()
        self._field = self._measured()

    @property
    def camera(self) -> CameraModel:
        """How this view truly sees; world = base frame."""
        return self._painted.camera

    @property
    def memory(self) -> int:
        """How many frames before it a picture shows traces of."""
        return len(self._weights) - 1

    def render(
        self,
        shapes_m: FloatArray,
        tissue: TissueState | None = None,
        *,
        frame: int = 0,
        time_s: float = 0.0,
        before: Sequence[Pulse] = (),
    ) -> Picture8Or16:
        """(h, w) picture. ``frame`` picks the noise; ``time_s``: where heart, breath and instruments are.

        ``tissue``: where the heart's wall has moved to, and the heart's shadow with it; without it the heart beats by
        the scene's own rhythm. ``before``: the pulses before this one, newest last, whose lag is still seen;
        `memory` of them matter. What of them this thread has drawn last is not drawn again.
        """
        now = Pulse(shapes_m, tissue, frame, time_s)
        known = list(before)[-self.memory :] if self.memory else []
        planes = [self._quanta(pulse) for pulse in (*known, now)][::-1]
        desk, detector = self._desk(), self._plane.detector
        with_lag(planes, self._weights, desk.light)
        signal = blurred(desk.light, detector, self._finer)
        picture: Picture8Or16
        picture = np.empty(signal.shape, np.uint8) if self.bits == 8 else np.empty(signal.shape, np.uint16)
        key = frame_key(self.scene.seed, self.view, frame, 1)
        curve, gauss = self._curve, self._tables.gauss
        read_out(signal, key, gauss, detector.electronic, detector.line_noise, curve.levels, curve.per_root, picture)
        return picture

    def run(self, pulses: Iterable[Pulse]) -> Iterator[Picture8Or16]:
        """Pictures of pulses that follow each other, each with the lag of those before it."""
        before: list[Pulse] = []
        for pulse in pulses:
            yield self.render(
                pulse.shapes_m, pulse.tissue, frame=pulse.frame, time_s=pulse.time_s, before=tuple(before)
            )
            before = [*before, pulse][-max(1, self.memory) :]

    def light(self, shapes_m: FloatArray, tissue: TissueState | None = None, *, time_s: float = 0.0) -> Picture:
        """(h, w): quanta a pixel that the detector expects of one pulse: before noise, blur and lag."""
        desk = self._desk()
        self._expect(desk, Pulse(shapes_m, tissue, 0, time_s))
        return desk.light.copy()

    def truth(self, shapes_m: FloatArray, tissue: TissueState | None = None, *, time_s: float = 0.0) -> PictureTruth:
        """What there is to be seen of the catheter in that picture; neither tissue nor time change it."""
        del tissue, time_s
        h, w = self._painted.still.shape
        return picture_truth(self.camera, instants(checked(shapes_m), 1)[0], self.scene.catheter.radius_m, h, w)

    def _quanta(self, pulse: Pulse) -> Quanta:
        """The noise of one pulse, alone; kept for the frames after it."""
        desk = self._desk()
        for known, plane in desk.kept:
            if known.same(pulse):
                return plane
        self._expect(desk, pulse)
        plane = np.empty(desk.light.shape, np.uint16)
        key = frame_key(self.scene.seed, self.view, pulse.frame, 0)
        draw_quanta(desk.light, key, self._tables.alias, self._tables.gauss, plane)
        desk.kept = [*desk.kept, (pulse, plane)][-(self.memory + 1) :]
        return plane

    def _expect(self, desk: _Desk, pulse: Pulse) -> None:
        """Leave the expected quanta of ``pulse`` in ``desk.light``."""
        painted, rhythm = self._painted, self.scene.rhythm
        self._lay_tubes(desk, pulse)
        breath = rhythm.breath(pulse.time_s)
        wall = None
        if pulse.tissue is not None:
            _, slopes = painted.camera.project_with_slopes(np.zeros((1, 3)))
            moved = slopes[0] @ pulse.tissue.shift_m.mean(axis=0)
            wall = float(moved[0]), float(moved[1])
        self._shine(desk, breath, rhythm.beating(pulse.time_s), wall)
        desk.taken[:] = 0.0
        delayed = rhythm.breath(pulse.time_s - self._plane.beam.control_s)
        exposure = self._photons / float(np.interp(delayed, np.linspace(0.0, 1.0, len(self._field)), self._field))
        self._veil.add(desk.light, desk.blocks, exposure)

    def _shine(self, desk: _Desk, breath: float, beating: float, wall_px: tuple[float, float] | None) -> None:
        painted = self._painted
        soft = soft_layers(painted, self.scene.rhythm, breath, beating, wall_px)
        ribs = 0.15 * self.scene.rhythm.breath_m * breath * painted.head_px  # the ribs rise as the diaphragm sinks
        left, top = painted.margin - float(ribs[0]), painted.margin - float(ribs[1])
        direct_light(painted.still, painted.chest, left, top, soft, desk.taken, desk.light, desk.blocks)

    def _lay_tubes(self, desk: _Desk, pulse: Pulse) -> None:
        """What catheter and devices take from the light into ``desk.taken``."""
        painted = self._painted
        for item in painted.devices:
            points = swayed(item.device, item.points_m, item.share, self.scene.rhythm, pulse.time_s)
            item.tube.add(desk.drawn, desk.spans, painted.patient_camera, points)
        fold_instant(desk.drawn, desk.spans, desk.taken, 1.0)
        desk.spans[:] = no_spans(len(desk.spans))
        shapes = moments(checked(pulse.shapes_m), painted.px_per_m)
        for points in shapes:
            painted.catheter.add(desk.drawn, desk.spans, painted.camera, points)
            fold_instant(desk.drawn, desk.spans, desk.tube, 1.0 / len(shapes))
        join_taken(desk.tube, desk.spans, desk.taken)
        desk.spans[:] = no_spans(len(desk.spans))

    def _measured(self) -> FloatArray:
        """(5,) what of the rays reaches the measuring field without the catheter, by the patient's breath."""
        desk = self._desk()
        h, w = desk.light.shape
        v, u = np.mgrid[0:h, 0:w]
        inside = np.hypot((v + 0.5) / h - 0.5, (u + 0.5) / w - 0.5) < _FIELD
        means: list[float] = []
        for breath in np.linspace(0.0, 1.0, 5):
            self._shine(desk, float(breath), 0.0, None)
            self._veil.add(desk.light, desk.blocks, 1.0)
            means.append(float(desk.light[inside].mean()))
        return np.array(means)

    def _desk(self) -> _Desk:
        desk = getattr(self._desks, "desk", None)
        if desk is None:
            desk = self._desks.desk = _Desk.of(*self._painted.still.shape)
        return desk


def checked(shapes_m: FloatArray) -> FloatArray:
    """``shapes_m`` as the hot loops take it; raises ValueError where it is not (m, n, 3)."""
    shapes = np.ascontiguousarray(shapes_m, np.float64)
    if shapes.ndim != 3 or shapes.shape[2] != 3 or shapes.shape[1] < 3 or not len(shapes):
        raise ValueError(f"shapes_m: expected shape (m, n, 3) with n > 2, got {shapes.shape}")
    return shapes


def moments(shapes: FloatArray, px_per_m: float) -> FloatArray:
    """As many `instants` as motion blur needs."""
    way = float(np.abs(np.diff(shapes, axis=0)).max(axis=(1, 2), initial=0.0).sum()) * px_per_m
    return instants(shapes, max(1, min(_MOST_INSTANTS, math.ceil(way / _STEP_PX))))
