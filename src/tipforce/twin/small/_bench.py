"""The small bench as a source of events, and frame by frame."""

import math
from collections.abc import Iterator
from functools import cached_property
from types import TracebackType
from typing import Any, Self

import numpy as np

from ...types import Actuation, Catheter, Context, Event, FloatArray, Frame, Image, SimulatedClock, Wrench
from .._sessions import stated
from ._render import add_noise, draw_catheter, draw_wall
from ._scene import Scene, build_scene
from ._sensor import SensorLog, read_sensor
from ._session import LEAD_S, STEP_S, Course, Session, run_session
from ._settings import SmallBenchSettings
from ._truth import Truth

__all__ = ["SmallBench"]

_COLOURS = np.array([[222.0, 186.0, 176.0], [158.0, 162.0, 166.0], [176.0, 178.0, 180.0]])
"""RGB of pad, plate and arm in the middle of the light."""
_DENT_M = 3.5e-3
"""Half width of the dent that the tip makes in the pad's outline."""
_BEHIND_PX = 40.0
"""The catheter goes on straight behind its clamp."""
_STEP_PX = 0.7
"""The catheter moves at most this far between two of the shapes that make up an exposure."""
_MAX_SHAPES = 8


class SmallBench:
    """One session of the simulated bench: yields pictures, force readings and the knob's angle.

    Camera and knob are stamped by the camera's clock, whose zero is the first frame; the force sensor stamps by its
    own, and reads tip-on-tissue in the frame "sensor", as `public` says. ``session`` is the number of the session of
    this ``seed``; the same three arguments give the same bytes. Nothing is computed before it is asked for.

    >>> bench = SmallBench(SmallBenchSettings(seconds=8), seed=1)
    >>> with bench as events:
    ...     sorted({type(event).__name__ for event, _ in zip(events, range(200))})
    ['Actuation', 'Frame', 'Wrench']
    >>> bench.context.catheter.diameter_m
    0.00233
    """

    def __init__(self, settings: SmallBenchSettings | None = None, seed: int = 0, session: int = 0) -> None:
        self.settings = settings or SmallBenchSettings()
        self.seed = seed
        self.number = session
        self.clock = SimulatedClock()
        """Simulated time on the camera's clock; stands at the event that was yielded last."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass  # nothing is held open

    @property
    def name(self) -> str:
        """What the session is called."""
        return f"session_{self.number:02d}"

    @cached_property
    def _course(self) -> tuple[Session, Course]:
        return run_session(self.settings, self.seed, self.number)

    @cached_property
    def _scene(self) -> Scene:
        return build_scene(self.settings, *self._course, np.random.default_rng([self.seed, self.number, 2]))

    @cached_property
    def _log(self) -> SensorLog:
        return read_sensor(self.settings, *self._course, np.random.default_rng([self.seed, self.number, 3]))

    @property
    def frames(self) -> int:
        """Number of frames in the session."""
        return round(self.settings.seconds * self.settings.fps)

    def stamp_ns(self, index: int) -> int:
        """Middle of the exposure of frame ``index``."""
        return round(index * 1e9 / self.settings.fps)

    def _at(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """At times ``t`` (k,): angles (k, segments + 1), wall (k, 3): position, way along, dent; touch (k, 2)."""
        course = self._course[1]
        place = np.clip((t + LEAD_S) / STEP_S, 0, course.time_s.size - 1.000001)
        low = place.astype(np.int64)
        share = place - low

        def between(values: FloatArray) -> FloatArray:
            part = share.reshape(-1, *[1] * (values.ndim - 1))
            return values[low] * (1 - part) + values[low + 1] * part

        contact = course.contact
        wall = [between(values) for values in (course.position_m, course.along_m, contact.indentation_m)]
        return between(contact.angles_rad), np.stack(wall, axis=1), between(contact.touch_m)

    def _shapes(self, t: float) -> FloatArray:
        """(k, n, 2) px: the axis, base to middle of the dome, at k times that share the exposure around ``t``."""
        scene, rod = self._scene, self._course[0].rod
        half = self.settings.exposure_s / 2
        ends, _, touch = self._at(np.array([t - half, t + half]))
        tips = rod.nodes_m(ends)[:, -1]
        way = max(np.linalg.norm(tips[1] - tips[0]), np.linalg.norm(touch[1] - touch[0])) / scene.metres_per_px
        count = int(min(_MAX_SHAPES, 1 + way // _STEP_PX))
        times = t + half * ((2 * np.arange(count) + 1) / count - 1)
        angles = self._at(times)[0]
        nodes = rod.nodes_m(angles)
        axis = np.stack([np.cos(angles[:, -1]), np.sin(angles[:, -1])], axis=1)
        nodes[:, -1] -= 0.5 * self.settings.diameter_m * axis
        behind = np.tile([[-_BEHIND_PX * scene.metres_per_px, 0.0]], (count, 1, 1))
        nodes = np.concatenate([behind, nodes], axis=1)
        return scene.base.to_image(nodes.reshape(-1, 2) / scene.metres_per_px).reshape(nodes.shape)

    def picture(self, index: int) -> Image:
        """(h, w, 3) RGB: what the camera delivers as frame ``index``."""
        scene, settings = self._scene, self.settings
        t = index / settings.fps
        half = settings.exposure_s / 2
        _, wall, touch = self._at(np.array([t - half, t, t + half]))
        wall_px = wall / scene.metres_per_px
        tangent = np.array([-math.sin(self._course[0].wall.angle_rad), math.cos(self._course[0].wall.angle_rad)])
        place = np.array([*wall_px[1], touch[1] @ tangent / scene.metres_per_px - wall_px[1, 1], 0.0])
        place[4] = _DENT_M / scene.metres_per_px
        # A box moving by m during the exposure has the variance m^2 / 12: enough for the wall's straight outline.
        smear = math.hypot(scene.blur_px, (wall_px[2, 0] - wall_px[0, 0]) / math.sqrt(12))
        clean = scene.ground.copy()
        shadow = -scene.light_px[:2] / scene.light_px[2]
        draw_wall(
            clean, scene.base.origin_px, scene.into_px, scene.across_px, scene.boxes_px, scene.brightness * _COLOURS,
            place, smear, 22.0 * np.array([shadow @ scene.into_px, shadow @ scene.across_px]), scene.tile,
        )  # fmt: skip
        draw_catheter(
            clean, self._shapes(t), _BEHIND_PX, 0.5 * settings.diameter_m / scene.metres_per_px, scene.blur_px,
            scene.metal, scene.light_px, scene.brightness, 16.0 * shadow,
        )  # fmt: skip
        rng = np.random.default_rng([self.seed, self.number, 4, index])
        starts = 3 * rng.integers(0, (scene.noise.size - 3 * settings.width) // 3, settings.height)
        image = np.empty(clean.shape, np.uint8)
        add_noise(clean, scene.noise, starts, settings.noise_grey, image)
        return image

    def camera(self) -> Iterator[Frame]:
        """All frames in order."""
        for index in range(self.frames):
            yield Frame(self.stamp_ns(index), self.picture(index))

    def force_log(self) -> SensorLog:
        """All readings of the force sensor, on its own clock."""
        return self._log

    def __iter__(self) -> Iterator[Event]:
        log = self._log
        stamps = np.round(log.time_s * 1e9).astype(np.int64)
        offset = round(log.clock_offset_s * 1e9)
        reading = 0
        for index in range(self.frames):
            now = self.stamp_ns(index)
            while reading < stamps.size and stamps[reading] + offset <= now:
                self.clock.sleep_until_ns(int(stamps[reading]) + offset)
                yield Wrench(int(stamps[reading]), log.force_n[reading], np.zeros(3), frame="sensor")
                reading += 1
            self.clock.sleep_until_ns(now)
            yield Actuation(now, {"knob_deg": self.settings.knob_deg})
            yield Frame(now, self.picture(index))

    @cached_property
    def context(self) -> Context:
        """What is written on the sheet beside the bench."""
        facts = self.public()
        return Context(
            session=self.name,
            catheter=Catheter(**facts["catheter"]),
            metres_per_px=facts["metres_per_px"],
            notes={key: str(facts[key]) for key in ("knob_deg", "sensor_angle_deg", "reads", "no_contact_s")},
        )

    def public(self) -> dict[str, Any]:
        """What a person at the bench would know and write down; nothing of the truth."""
        settings = self.settings
        return {
            "session": self.name,
            "simulated": True,
            "catheter": {
                "name": "7F ablation catheter with 8 mm tip",
                "diameter_m": settings.diameter_m,
                "flexible_length_m": round(float(np.mean(settings.flexible_length_m)), 4),
                "rigid_length_m": settings.rigid_length_m,
                "bending_stiffness_nm2": round(float(np.mean(settings.stiffness_nm2)), 6),
            },
            "knob_deg": settings.knob_deg,
            "metres_per_px": self._log.measured_metres_per_px(self._scene.metres_per_px),
            "base_side": "left",
            "sensor_angle_deg": self._log.nominal_angle_deg,
            "reads": "tip-on-tissue",
            "no_contact_s": [0.0, settings.tare_s],
            "frames_per_s": settings.fps,
        }

    def truth(self) -> Truth:
        """What only an evaluation may see."""
        session, course = self._course
        scene, log = self._scene, self._log
        t = np.arange(self.frames) / self.settings.fps
        angles, _, _ = self._at(t)
        row = np.clip(np.round((t + LEAD_S) / STEP_S).astype(np.int64), 0, course.time_s.size - 1)
        force = np.zeros((t.size, 3))
        force[:, :2] = course.contact.force_n[row]
        points = session.rod.segments + 11
        lines = np.array([session.rod.centreline_m(row_angles, points) for row_angles in angles])
        return Truth(
            session=self.name,
            stamp_ns=np.array([self.stamp_ns(k) for k in range(self.frames)]),
            force_n=force,
            touching=course.contact.touching[row],
            centreline_m=lines,
            base=scene.base,
            metres_per_px=scene.metres_per_px,
            clock_offset_s=log.clock_offset_s,
            values={
                "contact_angle_deg": session.contact_angle_deg,
                "wall_angle_rad": session.wall.angle_rad,
                "wall_stiffness_n_per_m": session.wall.stiffness_n_per_m,
                "wall_damping_ns_per_m": session.wall.damping_ns_per_m,
                "friction": session.wall.friction,
                "flexible_length_m": session.rod.flexible_length_m,
                "bending_stiffness_nm2": session.rod.bending_stiffness_nm2,
                "precurvature_per_m": float(session.rod.precurvature_per_m),
                "beat_hz": session.beat_hz,
                "amplitude_m": session.amplitude_m,
                "lateral_m": session.lateral_m,
                "respiration_m": session.respiration_m,
                "sensor_angle_deg": log.true_angle_deg,
                "sensor_drift_n_per_s": log.drift_n_per_s,
                "blur_px": scene.blur_px,
                "redraws": float(session.redraws),
            },
            settings=stated(self.settings, self.seed, self.number),
        )
