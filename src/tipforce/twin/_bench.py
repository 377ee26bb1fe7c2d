"""One session of the twin as a source of events."""

from collections.abc import Iterator
from dataclasses import asdict
from functools import cached_property
from types import TracebackType
from typing import Any, Self

import numpy as np

from ..types import Catheter, Clock, Context, Event, FloatArray, Frame, IntArray, SimulatedClock
from ._readings import Readings
from ._settings import TwinSettings
from .camera import CameraRenderer, CameraScene, PictureTruth, TissueHome, TissueState, draw_scene
from .world import FINE, LEAD_S, STEP_S, Course, Pace, SensorLog, Session, run_session, smooth_lines

__all__ = ["TwinBench"]

_POINTS = 97
"""Of the true centreline: half a millimetre apart."""
_EXPOSURE_SHAPES = 9


class TwinBench:
    """Session ``session`` of ``seed`` on the bench of ``settings``: pictures, force readings, knob and stage.

    A `Source` and context manager. Camera, knob and stage are stamped by the camera's clock, whose zero is where the
    first frame would be without jitter; the force sensor stamps by its own, and reads tip-on-tissue in the frame
    "sensor". `context` holds what a person at the bench would know, `truth` what only an evaluation may see. The same
    arguments give the same bytes. Nothing is computed before it is asked for. ``pace``: how finely the world is run;
    ``name``: what the session is called, session_00 and so on by default.
    """

    def __init__(
        self,
        settings: TwinSettings | None = None,
        seed: int = 0,
        session: int = 0,
        *,
        pace: Pace = FINE,
        name: str = "",
    ) -> None:
        self.settings = settings or TwinSettings()
        self.seed, self.number, self.pace = seed, session, pace
        self.name = name or f"session_{session:02d}"
        self.clock: Clock = SimulatedClock()
        """Simulated time on the camera's clock; stands at the event that was yielded last."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass  # nothing is held open

    def _rng(self, purpose: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, self.number, purpose])

    @cached_property
    def session(self) -> Session:
        """What is drawn and what happens: the truth."""
        return run_session(self.settings.world, self.seed, self.number, self.pace)

    @property
    def course(self) -> Course:
        """What happens, instant by instant."""
        return self.session.course

    @cached_property
    def scene(self) -> CameraScene:
        """What the camera looks at."""
        rig = self.session.rig
        ranges = self.settings.scene.model_copy(update={"diameter_m": rig.draw.device.diameter_m})
        return draw_scene(ranges, self._rng(2), length_m=rig.rod.length_m)

    @cached_property
    def renderer(self) -> CameraRenderer:
        """Draws the pictures."""
        rig, settings = self.session.rig, self.settings
        return CameraRenderer(
            scene=self.scene,
            camera=self.scene.camera(settings.width, settings.height),
            length_m=rig.rod.length_m,
            tissue=TissueHome(rig.touch_m, np.asarray(rig.wall.normal)),
            width=settings.width,
            height=settings.height,
        )

    @cached_property
    def readings(self) -> Readings:
        """All that is read but the pictures."""
        readings = Readings(self.session.rig, self._place, self._rng(3))
        readings.take(self.course, self._rows_known())
        return readings

    def _rows_known(self) -> int:
        """How many of the course's instants are known."""
        return self.course.time_s.size

    @property
    def log(self) -> SensorLog:
        """All readings of the force sensor, on its own clock."""
        return self.readings.log

    @cached_property
    def frame_s(self) -> FloatArray:
        """(n,) middle of each exposure, of the frames that were not dropped."""
        clock, rng = self.settings.world.clock, self._rng(4)
        count = round(self.settings.world.seconds * clock.fps)
        most = min(3.0 * clock.jitter_s, 0.45 / clock.fps)  # no frame comes before the one ahead of it
        jitter = np.clip(rng.standard_normal(count) * clock.jitter_s, -most, most)
        jitter[0] = abs(jitter[0])  # no stamp lies before zero
        kept = rng.random(count) >= clock.dropped_share
        return (np.arange(count) / clock.fps + jitter)[kept]

    @property
    def stamp_ns(self) -> IntArray:
        """(n,) the frames' stamps."""
        return np.round(self.frame_s * 1e9).astype(np.int64)

    def _place(self, time_s: FloatArray) -> tuple[IntArray, FloatArray]:
        """Instant before each time, and how far it is from there to the next."""
        place = (time_s + LEAD_S) / (STEP_S * self.pace.every)
        low = np.clip(np.floor(place).astype(np.int64), 0, self.course.time_s.size - 2)
        return low, place - low

    def nearest(self, time_s: FloatArray) -> IntArray:
        """(k,) the course's instants nearest to ``time_s``."""
        low, share = self._place(time_s)
        return low + (share >= 0.5)

    def at(self, values: FloatArray, time_s: FloatArray) -> FloatArray:
        """``values`` (m, ...) of the course at ``time_s`` (k,): linear between instants."""
        low, share = self._place(time_s)
        part = share.reshape(-1, *[1] * (values.ndim - 1))
        return values[low] * (1 - part) + values[low + 1] * part

    def lines_m(self, time_s: FloatArray) -> FloatArray:
        """(k, points, 3): the centreline at ``time_s`` (k,), base frame, base to apex, uniform in arc length."""
        low, share = self._place(time_s)
        course, rod = self.course, self.session.rig.rod
        before, after = (
            smooth_lines(rod, course.contact.quaternions[rows], _POINTS, course.advance_m[rows])
            for rows in (low, low + 1)
        )
        return before + share[:, None, None] * (after - before)

    def _exposure(self, index: int, shares: FloatArray) -> tuple[FloatArray, TissueState]:
        """Shapes and tissue at ``shares`` (m,) of half the exposure before (-1) to after (1) the middle of a frame."""
        middle = float(self.frame_s[index])
        times = middle + 0.5 * self.scene.exposure_s * shares
        course, rig = self.course, self.session.rig
        now = np.array([middle])
        tissue = TissueState(
            shift_m=self.at(course.wall_m, times) - rig.touch_m,
            dent_m=float(self.at(course.contact.indentation_m, now)[0]),
            touch_m=self.at(course.contact.touch_m, now)[0],
        )
        return self.lines_m(times), tissue

    def frame(self, index: int) -> Frame:
        """The ``index``-th picture."""
        shapes, tissue = self._exposure(index, np.linspace(-1.0, 1.0, _EXPOSURE_SHAPES))
        image = self.renderer.render(shapes, tissue, frame=index, time_s=float(self.frame_s[index]))
        return Frame(int(self.stamp_ns[index]), image)

    def picture_truth(self, index: int) -> PictureTruth:
        """What frame ``index`` shows of the catheter."""
        shapes, tissue = self._exposure(index, np.zeros(1))
        return self.renderer.truth(shapes, tissue, time_s=float(self.frame_s[index]))

    def stage_log(self) -> tuple[IntArray, dict[str, FloatArray]]:
        """Stamps (k,) and the commanded positions of the stage's axes in mm."""
        stage = self.readings.stage
        return stage.stamp_ns, dict(zip(stage.names, stage.values.T, strict=True))

    def knob_log(self) -> tuple[IntArray, FloatArray]:
        """Stamps (k,) and the knob's reading in degrees (k,)."""
        joints = self.readings.joints
        return joints.stamp_ns, joints.values[:, 0]

    def schedule(self) -> list[tuple[int, int, int]]:
        """All events in their order: when, on this bench's clock in ns, which stream's, and its place in that."""
        readings = self.readings
        force_ns = np.round(readings.log.true_s * 1e9).astype(np.int64)
        stamps = (force_ns, readings.stage.stamp_ns, readings.joints.stamp_ns, self.stamp_ns)
        arrival = np.concatenate([own + late for own, late in zip(stamps, self._delays_ns(), strict=True)])
        stream = np.repeat(np.arange(len(stamps)), [len(own) for own in stamps])
        row = np.concatenate([np.arange(len(own)) for own in stamps])
        order = np.argsort(arrival, kind="stable")
        return list(zip(arrival[order].tolist(), stream[order].tolist(), row[order].tolist(), strict=True))

    def _delays_ns(self) -> tuple[int, ...]:
        """By stream: in a recording all stands when it happened."""
        return (0, 0, 0, 0)

    def event(self, stream: int, row: int) -> Event:
        """The event at a place of `schedule`."""
        readings = self.readings
        match stream:
            case 0:
                return readings.wrench(row)
            case 1:
                return readings.actuation(readings.stage, row)
            case 2:
                return readings.actuation(readings.joints, row)
            case _:
                return self.frame(row)

    def __iter__(self) -> Iterator[Event]:
        for at_ns, stream, row in self.schedule():
            self.clock.sleep_until_ns(at_ns)
            yield self.event(stream, row)

    @property
    def context(self) -> Context:
        """What is written on the sheet beside the bench."""
        return self._sheet

    @cached_property
    def _sheet(self) -> Context:
        world, device = self.settings.world, self.session.rig.draw.device
        off = self.settings.scale_error
        scale = self.scene.lens.scale_m_per_px * (1.0 + float(self._rng(5).uniform(-off, off)))
        return Context(
            session=self.name,
            catheter=Catheter(
                name=world.shaft.name,
                diameter_m=device.diameter_m,
                flexible_length_m=device.nominal_flexible_length_m,
                rigid_length_m=world.shaft.rigid_length_m,
                bending_stiffness_nm2=device.nominal_stiffness_nm2,
            ),
            metres_per_px=float(f"{scale * 640.0 / self.settings.width:.4g}"),
            notes={
                "simulated": "true",
                "preset": self.settings.preset,
                "base_side": "left",
                "knob_gain_per_m_deg": f"{world.actuation.gain_per_m_deg:g}",
                "sensor_angle_deg": f"{self.log.nominal_angle_deg:g}",
                "reads": "tip-on-tissue",
                "moving_mass_kg": f"{world.sensor.moving_mass_kg:g}",
                "no_contact_s": f"0:{world.tare_s:g}",
            },
        )

    def values(self) -> dict[str, Any]:
        """All that was drawn, flat."""
        session, log = self.session, self.log
        draw = asdict(session.rig.draw)
        return {
            **draw.pop("device"),
            **draw,
            **asdict(session.motion),
            "wall_normal": session.rig.wall.normal.tolist(),
            "forward": session.rig.forward.tolist(),
            "bias_n": log.bias_n.tolist(),
            "drift_n_per_s": log.drift_n_per_s.tolist(),
            "redraws": session.redraws,
            "lens": asdict(self.scene.lens),
        }
