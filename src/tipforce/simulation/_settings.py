"""All settings of a simulated bench, and the presets of the benchmark protocol."""

import operator
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from ._fields import Settings
from .rendering.camera import GENERALISE, THESIS_PLAIN, VARIED, SceneRanges
from .rendering.fluoroscope import BIPLANE, BIPLANE_VARIED, FLUORO, FLUORO_VARIED, XrayRanges
from .world.settings import (
    ActuationSettings,
    ClockSettings,
    MotionSettings,
    SensorSettings,
    ShaftSettings,
    WallSettings,
    WorldSettings,
)


class _BenchSettings(Settings):
    preset: str = "bench-2021"
    """Name of the settings; changed settings have another name."""
    world: WorldSettings = WorldSettings()


_Side = Annotated[int, Field(ge=160, le=4096, multiple_of=2)]
"""Width or height of an image in px."""


class CameraChoice(Settings):
    """Cameras and their orientation: one entry of each list is drawn for a session, with equal probability."""

    sizes: Annotated[tuple[tuple[_Side, _Side], ...], Field(min_length=1)]
    fps: Annotated[tuple[Annotated[float, Field(gt=0, le=240)], ...], Field(min_length=1)]
    base_sides: Annotated[tuple[Literal["left", "right", "top", "bottom"], ...], Field(min_length=1)]


_DetectorSide = Annotated[int, Field(ge=128, le=2048, multiple_of=8)]
"""Width or height of a fluoroscope's image in px."""


class DetectorChoice(CameraChoice):
    """Detectors of a fluoroscope, pulse rates and orientation of the catheter: one entry of each list is drawn."""

    sizes: Annotated[tuple[tuple[_DetectorSide, _DetectorSide], ...], Field(min_length=1)]


class SimulationSettings(_BenchSettings):
    """A bench: the world, which is pressed and measured, and the camera that images it."""

    scene: SceneRanges = SceneRanges()
    scale_error: float = Field(default=0.01, ge=0, lt=1)
    """The scale of the image is measured with a uniform error of at most +- this share."""
    width: int = Field(default=640, ge=160, le=4096, multiple_of=2)
    height: int = Field(default=480, ge=120, le=4096, multiple_of=2)
    cameras: CameraChoice | None = Field(default=None, exclude_if=operator.not_)
    """A camera is drawn from these for each session; None: one camera for all. See `settings_of_session`."""


class FluoroSettings(_BenchSettings):
    """A bench inside a chest: the same world, and the fluoroscope that images it, in one plane or two.

    The device's diameter and tip, the heart rate and the breathing rate are those of the world, not those of ``scene``.
    """

    preset: str = "fluoro"
    scene: XrayRanges = FLUORO
    jpeg_quality: int = Field(default=95, ge=1, le=100)
    width: int = Field(default=512, ge=128, le=2048, multiple_of=8)
    height: int = Field(default=512, ge=128, le=2048, multiple_of=8)
    detectors: DetectorChoice | None = Field(default=None, exclude_if=operator.not_)
    """Detector, pulse rate and orientation are drawn from these for each session; None: the same for all."""
    view_delay_s: float = Field(default=0.0, ge=0.0, le=0.5, exclude_if=operator.not_)
    """The pulses of the second view come this much later than those of the first (alternating exposure)."""

    @model_validator(mode="after")
    def _second_view_before_the_next_pulse(self) -> Self:
        """Checks that a delayed second view exists and is exposed before the next pulse of the first one."""
        period_s = 1.0 / self.world.clock.fps
        if self.view_delay_s and self.scene.planes < 2:
            raise ValueError("expected two planes with view_delay_s; this bench has one")
        if not self.view_delay_s < period_s:
            raise ValueError(
                f"expected view_delay_s below the time between two pulses of a view, {period_s:.4f} s, "
                f"got {self.view_delay_s:g}"
            )
        return self


AnySimulationSettings = SimulationSettings | FluoroSettings


def _changed(world: WorldSettings, **parts: dict[str, Any]) -> WorldSettings:
    """Returns ``world`` with other values; ``parts``: for some of its parts, values by the name of the setting."""
    update = {part: getattr(world, part).model_copy(update=values) for part, values in parts.items()}
    return world.model_copy(update=update)


def settings_of_session(settings: AnySimulationSettings, seed: int, session: int) -> AnySimulationSettings:
    """Returns the settings of a bench with the camera or the detector of one session.

    Args:
        settings: settings of the bench.
        seed: seed of all random numbers.
        session: number of the session, from 0.

    Returns:
        The settings with one drawn size, rate and base side; ``settings`` where nothing is drawn.
    """
    choice = settings.cameras if isinstance(settings, SimulationSettings) else settings.detectors
    if choice is None:
        return settings
    rng = np.random.default_rng([seed, session, 8])
    width, height = choice.sizes[int(rng.integers(len(choice.sizes)))]
    fps = choice.fps[int(rng.integers(len(choice.fps)))]
    side = choice.base_sides[int(rng.integers(len(choice.base_sides)))]
    return settings.model_copy(
        update={
            "world": _changed(settings.world, clock={"fps": fps}),
            "scene": settings.scene.model_copy(update={"base_side": side}),
            "width": width,
            "height": height,
        }
    )


_FRENCH_M = 1e-3 / 3
"""1 F of diameter."""

_MANY_CATHETERS = WorldSettings(
    shaft=ShaftSettings(
        name="ablation catheter with 8 mm tip",
        diameter_m=(5 * _FRENCH_M, 8 * _FRENCH_M),
        flexible_length_m=(35e-3, 65e-3),
        stiffness_nm2=(3.1e-4, 9.2e-4),
        nominal_flexible_length_m=None,
        nominal_stiffness_nm2=None,
        known_to=0.05,
        sessions_per_catheter=5,
    ),
    actuation=ActuationSettings(knob_deg=(0.0, 30.0), knob_deg_per_s=10.0),
    wall=WallSettings(contact_angle_deg=(0.0, 80.0), either_side=True),
)
_IN_SPACE = _changed(
    _MANY_CATHETERS,
    shaft={"out_of_plane_per_m": (-6.0, 6.0)},
    wall={"tilt_deg": (-45.0, 45.0)},
    clock={"fps": 15.0},
)
"""Shaft and wall are out of the image plane, as in a heart."""

_OTHER_BENCHES = _changed(
    _MANY_CATHETERS,
    shaft={"diameter_m": (5 * _FRENCH_M, 9 * _FRENCH_M), "diameter_known_to": 0.05},
    wall={
        "stiffness_n_per_m": (30.0, 500.0),
        "log_stiffness": True,
        "laws": ("linear", "hertz", "exponential"),
        "loss_factors": (0.1, 0.5),
        "faces": ("flat", "convex", "concave"),
    },
    motion={"by_hand_share": 0.5, "peak_force_n": (0.05, 0.60), "peak_within_n": 5e-3, "same_peak": 12},
)
_OTHER_CATHETERS = _changed(
    _IN_SPACE,
    shaft={"name": "ablation catheter", "diameter_m": (4 * _FRENCH_M, 9 * _FRENCH_M), "diameter_known_to": 0.05},
)
_GUIDEWIRE_KNOTS = ((0.0, 1.0), (0.15, 1.0), (0.3, 0.58), (0.45, 0.31), (0.6, 0.15), (0.75, 0.07), (1.0, 0.05))
"""The guidewire's EI falls towards its end, see ``stiffness_knots``."""
_DETECTORS = DetectorChoice(
    sizes=((512, 512), (512, 512), (768, 768), (1024, 1024)),
    fps=(7.5, 15.0),
    base_sides=("left", "right", "top", "bottom"),
)

PRESETS: dict[str, AnySimulationSettings] = {
    "bench-2021": SimulationSettings(),
    "generalise": SimulationSettings(preset="generalise", world=_MANY_CATHETERS, scene=GENERALISE),
    "fluoro": FluoroSettings(world=_IN_SPACE),
    "biplane": FluoroSettings(preset="biplane", world=_IN_SPACE, scene=BIPLANE),
    "fluoro-varied": FluoroSettings(
        preset="fluoro-varied", world=_OTHER_CATHETERS, scene=FLUORO_VARIED, detectors=_DETECTORS
    ),
    "biplane-varied": FluoroSettings(
        preset="biplane-varied", world=_OTHER_CATHETERS, scene=BIPLANE_VARIED, detectors=_DETECTORS
    ),
    "varied": SimulationSettings(
        preset="varied",
        world=_OTHER_BENCHES,
        scene=VARIED,
        scale_error=0.02,
        cameras=CameraChoice(
            sizes=((640, 480), (800, 600), (1024, 768), (1280, 720), (1280, 960), (1280, 1024)),
            fps=(24.0, 25.0, 30.0, 50.0, 60.0),
            base_sides=("left", "right", "top", "bottom"),
        ),
    ),
    "thesis-2021-plain": SimulationSettings(preset="thesis-2021-plain", scene=THESIS_PLAIN),
    "thesis-2021": SimulationSettings(
        preset="thesis-2021",
        world=WorldSettings(
            shaft=ShaftSettings(sessions_per_catheter=1_000_000),
            motion=MotionSettings(
                amplitude_m=(2.5e-3, 5e-3),
                least_force_n=(0.160, 0.160),
                peak_force_n=(0.275, 0.275),
                peak_within_n=1e-3,
            ),
            clock=ClockSettings(images_from_s=6.5),
            sessions_per_bench=1_000_000,
        ),
        scene=THESIS_PLAIN,
    ),
    "guidewire": SimulationSettings(
        preset="guidewire",
        world=WorldSettings(
            shaft=ShaftSettings(
                name="0.035 inch guidewire with a soft distal part",
                diameter_m=(0.889e-3, 0.889e-3),
                rigid_length_m=1e-3,
                flexible_length_m=(33e-3, 37e-3),
                stiffness_nm2=(2.9e-4 * 0.93, 2.9e-4 * 1.07),
                nominal_flexible_length_m=35e-3,
                nominal_stiffness_nm2=2.9e-4,
                proximal_stiffer=0.0,
                stiffness_knots=_GUIDEWIRE_KNOTS,
                creep_share=0.01,
            ),
            actuation=ActuationSettings(knob_deg=(0.0, 0.0), gain_per_m_deg=0.0, play_deg=0.0, drift_rms=0.0),
            wall=WallSettings(stiffness_n_per_m=(37.0, 55.0), friction=(0.04, 0.2)),
            motion=MotionSettings(peak_force_n=(0.03, 0.10)),
            sensor=SensorSettings(
                moving_mass_kg=0.02,
                noise_n=1e-3,
                step_n=(1e-3, 1e-3, 2e-3),
                drift_n_per_min=(-1e-3, 1e-3),
                bias_n=(-0.05, 0.05),
                torque_noise_nm=2e-5,
                torque_step_nm=5e-5,
            ),
        ),
        scene=SceneRanges(
            scale_m_per_px=(0.095e-3, 0.105e-3),
            camera_distance_m=(0.20, 0.30),
            diameter_m=0.889e-3,
            electrode_m=1e-3,
            rings=0,
            objects_clear_m=(9e-3, 13e-3),
            shaft_grey=(35.0, 80.0),
            shaft_tint=0.35,
            metal_grey=(95.0, 150.0),
        ),
    ),
    "catheter-5f": SimulationSettings(
        preset="catheter-5f",
        world=WorldSettings(
            shaft=ShaftSettings(
                name="5F steerable catheter with 4 mm tip",
                diameter_m=(5 * _FRENCH_M, 5 * _FRENCH_M),
                rigid_length_m=4e-3,
                flexible_length_m=(29e-3, 31e-3),
                stiffness_nm2=(1.12e-4 * 0.95, 1.12e-4 * 1.05),
                nominal_flexible_length_m=30e-3,
                nominal_stiffness_nm2=1.12e-4,
            ),
            wall=WallSettings(stiffness_n_per_m=(69.0, 103.0)),
            motion=MotionSettings(peak_force_n=(0.06, 0.18)),
        ),
        scene=SceneRanges(
            scale_m_per_px=(0.133e-3, 0.147e-3),
            camera_distance_m=(0.25, 0.40),
            diameter_m=5 * _FRENCH_M,
            electrode_m=4e-3,
            ring_m=1e-3,
            ring_gap_m=2e-3,
            objects_clear_m=(11e-3, 15e-3),
        ),
    ),
}
"""Presets by name. ``bench-2021``, ``generalise``, ``fluoro``, ``biplane``, ``fluoro-varied``, ``biplane-varied``,
``varied``, ``thesis-2021-plain`` and ``thesis-2021`` are frozen: a changed preset gets a new name."""
