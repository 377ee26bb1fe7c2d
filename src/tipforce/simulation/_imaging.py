"""The imaging of a session: one camera, or a fluoroscope in one plane or two."""

import math
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import cached_property
from typing import Any, cast

import numpy as np

from ..geometry import CameraModel
from ..types import FloatArray, Image, IntArray, ViewInfo
from ._fields import standard_uncertainty
from ._settings import AnySimulationSettings, FluoroSettings, SimulationSettings
from .rendering.camera import CameraRenderer, Framing, ImageTruth, TissueHome, TissueState, sample_scene
from .rendering.fluoroscope import Pulse, XrayRenderer, sample_xray_scene
from .world import APPROACH_S, BenchModel, Session

Exposed = Callable[[float, float, int], tuple[FloatArray, TissueState]]
"""Middle of an exposure and its length in seconds, number of instants -> shapes (m, n, 3) and the tissue."""
_CAMERA_EXPOSURE_INSTANTS, _XRAY_EXPOSURE_INSTANTS = 9, 5
_KEPT_PULSES = 16


def view_names(settings: AnySimulationSettings) -> tuple[str, ...]:
    """Returns the names of the images' streams: "camera" for one, "a" and "b" for two."""
    return ("a", "b") if isinstance(settings, FluoroSettings) and settings.scene.planes == 2 else ("camera",)


def view_delays_s(settings: AnySimulationSettings) -> dict[str, float]:
    """Returns by view how much later its exposures are than those of the first view, in s."""
    names = view_names(settings)
    delay_s = settings.view_delay_s if isinstance(settings, FluoroSettings) else 0.0
    return {name: delay_s if place else 0.0 for place, name in enumerate(names)}


_MAX_FRAMING_INSTANTS = 400
"""Largest number of instants of a session from which the camera's field of view is chosen."""


def _framing(settings: SimulationSettings, session: Session) -> Framing:
    """Returns the region that catheter and tissue cover in the planned motion after the approach, in the base frame.

    A person who sets up a camera knows this region and chooses the field of view for it.
    """
    world, trajectory, wall = settings.world, session.trajectory, session.bench_model.wall
    sampled = np.flatnonzero(trajectory.time_s > world.tare_s + APPROACH_S)
    sampled = sampled[:: max(1, sampled.size // _MAX_FRAMING_INSTANTS)]
    contact = trajectory.contact
    nodes_m = contact.rod.nodes_m(contact.quaternions[sampled], contact.advance_m[sampled])
    forward = np.asarray(wall.normal)[:2] / np.linalg.norm(np.asarray(wall.normal)[:2])
    face_m = float((trajectory.wall_m[sampled, :2] @ forward).min())  # where the wall has come farthest against the tip
    return Framing(
        size=(settings.width, settings.height),
        base_side=settings.scene.base_side,
        reach_m=np.concatenate([nodes_m[:, ::4].reshape(-1, 3), nodes_m[:, -1]]),
        forward=forward,
        face_m=face_m,
        behind_m=float((nodes_m[:, -1, :2] @ forward).max()) - face_m,
        aside_m=float(session.bench_model.touch_m[:2] @ np.array([-forward[1], forward[0]])),
        face_radius_m=wall.face_radius_m,
    )


class CameraImaging:
    """Draws the images of one camera in front of the bench.

    Args:
        settings: settings of the bench.
        session: the session.
        rngs: random numbers of the session's bench, and of its catheter.
        exposed: gives the shapes and the tissue during an exposure.
        times_s: (n,) middle of the exposure of each image.
        first_frame: number of the camera's first image in this session.
    """

    views = ("camera",)

    def __init__(
        self,
        settings: SimulationSettings,
        session: Session,
        rngs: tuple[np.random.Generator, np.random.Generator],
        exposed: Exposed,
        times_s: FloatArray,
        first_frame: int,
    ) -> None:
        """Draws the scene of the session; the renderer is made when the first image is needed."""
        bench_model, (rng, catheter_rng) = session.bench_model, rngs
        self._first_frame = first_frame
        self.settings, self._bench_model, self._exposed, self._times_s = settings, bench_model, exposed, times_s
        ranges = settings.scene.model_copy(update={"diameter_m": bench_model.parameters.device.diameter_m})
        self.scene = sample_scene(
            ranges,
            rng,
            length_m=bench_model.rod.length_m,
            framing=_framing(settings, session) if ranges.variety is not None else None,
            catheter_rng=catheter_rng,
        )

    @cached_property
    def renderer(self) -> CameraRenderer:
        """Draws the images."""
        bench_model, settings = self._bench_model, self.settings
        return CameraRenderer(
            scene=self.scene,
            camera=self.camera(),
            length_m=bench_model.rod.length_m,
            tissue=TissueHome(bench_model.touch_m, np.asarray(bench_model.wall.normal)),
            width=settings.width,
            height=settings.height,
        )

    @property
    def jpeg_quality(self) -> int:
        """JPEG quality of the recorded images, 1 to 100."""
        return self.scene.jpeg_quality

    @property
    def exposure_s(self) -> float:
        """Time for which the shutter is open."""
        return self.scene.exposure_s

    def camera(self, view: str = "camera") -> CameraModel:
        """Returns the true camera model; world = base frame."""
        del view  # there is one
        return self.scene.camera(self.settings.width, self.settings.height)

    def image(self, view: str, index: int) -> Image:
        """Returns an image.

        Args:
            view: name of the only view; not used.
            index: number of the image, 0 to n - 1.

        Returns:
            (h, w) or (h, w, 3) image, 8 bits.
        """
        del view
        time_s = float(self._times_s[index])
        shapes, tissue = self._exposed(time_s, self.scene.exposure_s, _CAMERA_EXPOSURE_INSTANTS)
        return self.renderer.render(shapes, tissue, frame=self._first_frame + index, time_s=time_s)

    def truth(self, view: str, index: int) -> ImageTruth:
        """Returns the ground truth of an image.

        Args:
            view: name of the only view; not used.
            index: number of the image, 0 to n - 1.

        Returns:
            The catheter in the image at the middle of the exposure.
        """
        del view
        time_s = float(self._times_s[index])
        shapes, tissue = self._exposed(time_s, self.scene.exposure_s, 1)
        return self.renderer.truth(shapes, tissue, time_s=time_s)

    def measured_scale_m_per_px(self, rng: np.random.Generator) -> float:
        """Returns the scale in m/px with a random error of at most the stated share (``scale_error``)."""
        off = self.settings.scale_error
        scale = self.scene.lens.scale_m_per_px * (1.0 + float(rng.uniform(-off, off)))
        return scale * 640.0 / self.settings.width  # the scene states its scale for 640 columns

    def view_info(self, view: str, metres_per_px: float) -> ViewInfo:
        """Returns the metadata of the view that a person at the bench would know.

        Args:
            view: name of the only view; not used.
            metres_per_px: measured scale.

        Returns:
            Scale, side of the image at which the catheter enters, and uncertainties of scale and tilt.
        """
        del view
        scene = self.settings.scene
        return ViewInfo(
            metres_per_px,
            scene.base_side,
            metres_per_px_uncertainty=standard_uncertainty(-self.settings.scale_error, self.settings.scale_error),
            tilt_uncertainty_deg=standard_uncertainty(*scene.yaw_deg, *scene.pitch_deg),
        )

    def values(self) -> dict[str, Any]:
        """Returns the lens, and the drawn parameters of a varied scene."""
        values: dict[str, Any] = {"lens": asdict(self.scene.lens)}
        if self.settings.scene.variety is not None:
            scene = self.scene
            values |= {
                "ground": scene.ground.kind,
                "tissue_sight": scene.tissue.visibility,
                "rim_m": scene.tissue.rim_m,
                "sheath_radius_m": scene.sheath.appearance.radius_m if scene.sheath else 0.0,
                "fitting": scene.sheath.fitting if scene.sheath else "",
            }
        return values


class XrayImaging:
    """Draws the images of a fluoroscope in one plane or two.

    The pulses of the planes coincide, or alternate (``view_delay_s``); in both cases each plane scatters into the
    other. The heart rate and the breathing rate of the patient are those of the wall.

    Args:
        settings: settings of the bench.
        bench_model: the session's bench.
        rngs: random numbers of the scene, and of the catheter.
        exposed: gives the shapes and the tissue during a pulse.
        times_s: (m,) middle of each pulse.
        kept: (n,) indices of the pulses that became images.
    """

    def __init__(
        self,
        settings: FluoroSettings,
        bench_model: BenchModel,
        rngs: tuple[np.random.Generator, np.random.Generator],
        exposed: Exposed,
        times_s: FloatArray,
        kept: IntArray,
    ) -> None:
        """Draws the scene; the catheter's size and the rhythm of heart and breath are those of the session's bench."""
        self.settings, self._exposed, self._times_s, self._kept = settings, exposed, times_s, kept
        self.views, self._delays_s = view_names(settings), view_delays_s(settings)
        self._length_m = bench_model.rod.length_m
        parameters, breath_hz = bench_model.parameters, bench_model.settings.motion.respiration_hz
        diameter = parameters.device.diameter_m
        scene = sample_xray_scene(
            settings.scene.model_copy(
                update={
                    "diameter_m": (diameter, diameter),
                    "electrode_m": bench_model.settings.shaft.rigid_length_m,
                    "rate_hz": settings.world.clock.fps,
                }
            ),
            *rngs,
        )
        # At the maximum of its wave the wall is nearest to the tip: the heart is contracted and the lungs are full.
        rhythm = replace(
            scene.rhythm,
            heart_hz=parameters.beat_hz,
            heart_phase=0.25 if parameters.wave == "sine" else 0.5,
            breath_hz=breath_hz,
            breath_phase=(parameters.respiration_phase + 0.5 * math.pi) / (2.0 * math.pi),
        )
        self.scene = replace(scene, rhythm=rhythm)
        self._pulses: dict[tuple[int, float], Pulse] = {}

    @cached_property
    def _renderers(self) -> dict[str, XrayRenderer]:
        size = {"width": self.settings.width, "height": self.settings.height}
        return {
            name: XrayRenderer(self.scene, self._length_m, view=place, **size) for place, name in enumerate(self.views)
        }

    @property
    def jpeg_quality(self) -> int:
        """JPEG quality of the recorded images, 1 to 100."""
        return self.settings.jpeg_quality

    @property
    def exposure_s(self) -> float:
        """Length of one pulse."""
        return self.scene.views[0].beam.pulse_s

    def camera(self, view: str) -> CameraModel:
        """Returns the true camera model of a view; world = base frame."""
        return self.scene.camera(self.views.index(view), self.settings.width, self.settings.height)

    def image(self, view: str, index: int) -> Image:
        """Returns an image. It contains the detector's lag from earlier pulses, dropped ones included.

        Args:
            view: one of `views`.
            index: number of the image, 0 to n - 1.

        Returns:
            (h, w) image, 8 bits.
        """
        number, renderer = int(self._kept[index]), self._renderers[view]
        first, delay_s = max(0, number - renderer.memory), self._delays_s[view]
        *before, now = [self._pulse(k, delay_s) for k in range(first, number + 1)]
        image = renderer.render(now.shapes_m, now.tissue, frame=now.frame, time_s=now.time_s, before=before)
        return cast("Image", image)  # 8 bits

    def _pulse(self, number: int, delay_s: float) -> Pulse:
        """Returns the input of frame ``number``, exposed ``delay_s`` late; the last ones are stored for the lag."""
        if (number, delay_s) not in self._pulses:
            time_s = float(self._times_s[number]) + delay_s
            shapes, tissue = self._exposed(time_s, self.scene.views[0].beam.pulse_s, _XRAY_EXPOSURE_INSTANTS)
            if len(self._pulses) >= _KEPT_PULSES:
                del self._pulses[next(iter(self._pulses))]
            self._pulses[number, delay_s] = Pulse(shapes, tissue, number, time_s)
        return self._pulses[number, delay_s]

    def truth(self, view: str, index: int) -> ImageTruth:
        """Returns the ground truth of an image.

        Args:
            view: one of `views`.
            index: number of the image, 0 to n - 1.

        Returns:
            The catheter in the image at the middle of the pulse.
        """
        time_s = float(self._times_s[self._kept[index]]) + self._delays_s[view]
        shapes, tissue = self._exposed(time_s, self.scene.views[0].beam.pulse_s, 1)
        return self._renderers[view].truth(shapes, tissue, time_s=time_s)

    def measured_scale_m_per_px(self, rng: np.random.Generator) -> float:
        """Returns the scale in m/px at the isocentre, from the first view's calibration."""
        del rng  # its error was drawn with the scene
        return self.scene.views[0].stated.scale_m_per_px * 512.0 / self.settings.width  # stated for 512 columns

    def view_info(self, view: str, metres_per_px: float) -> ViewInfo:
        """Returns the metadata of a view that a person at the bench would know.

        Args:
            view: one of `views`.
            metres_per_px: measured scale.

        Returns:
            Scale, side of the image at which the catheter enters, and the calibrated projection matrix (3, 4) from the
            isocentre's frame.
        """
        size = self.settings.width, self.settings.height
        return ViewInfo(
            metres_per_px,
            self.settings.scene.base_side,
            modality="xray",
            metres_per_px_uncertainty=self._scale_uncertainty(),
            projection=self.scene.views[self.views.index(view)].stated.camera(*size).projection,
            projection_frame="isocentre",
        )

    def _scale_uncertainty(self) -> float | None:
        """Returns the relative standard uncertainty of the scale due to the catheter's unknown depth."""
        variety = self.settings.scene.variety
        if variety is None:
            return None
        source = 0.5 * sum(self.settings.scene.source_object_m)
        return standard_uncertainty(*(depth / source for depth in variety.depth_m))

    def values(self) -> dict[str, Any]:
        """Returns the true values of the scene: projection matrices, pose of the base, photons.

        A varied scene adds the electrodes (start and end in metres from the apex) and the drawn variety. The projection
        holds until the table or the C-arm moves.
        """
        pose, varied = self.scene.patient_from_base, {}
        if self.scene.variety is not None:
            tip, rings = self.scene.catheter.electrode_m, self.scene.catheter.rings_m
            varied = {"electrodes_m": [(0.0, tip), *rings], "variety": asdict(self.scene.variety)}
        return varied | {
            "projection": {name: self.camera(name).projection_matrix.tolist() for name in self.views},
            "isocentre_from_base": np.column_stack([pose.rotation, pose.translation_m]).tolist(),
            "photons": [view.beam.photons for view in self.scene.views],
        }


Imaging = CameraImaging | XrayImaging
"""Draws the images of a session."""


def make_imaging(
    settings: AnySimulationSettings,
    session: Session,
    rngs: tuple[np.random.Generator, np.random.Generator],
    exposed: Exposed,
    times_s: FloatArray,
    kept: IntArray,
    first_frame: int = 0,
) -> Imaging:
    """Makes the imaging of a session: a camera or a fluoroscope.

    Args:
        settings: settings of the bench.
        session: the session.
        rngs: random numbers of the session's bench, and of its catheter.
        exposed: gives the shapes and the tissue during an exposure.
        times_s: (m,) middle of all exposures.
        kept: (n,) indices of the exposures that became images.
        first_frame: number of the camera's first image in this session; the noise of an image follows from its number.

    Returns:
        The imaging, which draws each image when it is needed.
    """
    if isinstance(settings, FluoroSettings):
        return XrayImaging(settings, session.bench_model, rngs, exposed, times_s, kept)
    return CameraImaging(settings, session, rngs, exposed, times_s[kept], first_frame)
