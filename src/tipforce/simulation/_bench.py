"""One session of the simulated bench as a source of events."""

import math
from collections.abc import Iterator
from dataclasses import asdict
from functools import cached_property
from typing import Any

import numpy as np

from .._system.contexts import ClosedAtExit
from ..types import (
    ActuationInfo,
    BoolArray,
    Catheter,
    Clock,
    Event,
    FloatArray,
    Frame,
    IntArray,
    SensorInfo,
    SessionInfo,
    SimulatedClock,
    StageInfo,
    TissueInfo,
)
from ._imaging import Imaging, make_imaging, view_delays_s, view_names
from ._settings import AnySimulationSettings, SimulationSettings, settings_of_session
from ._trajectory_sampling import Readings, TrajectoryInterpolator
from .rendering.camera import ImageTruth
from .world import FINE, Resolution, SensorLog, Session, Trajectory, run_session

_MAX_FRAMES = 1_000_000
"""More images than any session has. Where sessions share a camera, each session has its own range of noise seeds."""


class SimulatedBench(ClosedAtExit):
    """Session ``session`` of ``seed`` on the bench of ``settings``: images, force readings, knob and stage.

    A `Source` and context manager. Camera, knob and stage are stamped by the camera's clock, whose zero is the time of
    the first frame without jitter. The force sensor is stamped by its own clock, and reads tip-on-tissue in the frame
    "sensor". The same arguments give the same bytes. Nothing is computed before it is needed.

    Args:
        settings: settings of the bench; None: those of the preset ``bench-2021``.
        seed: seed of all random numbers.
        session: number of the session, from 0.
        resolution: step size of the simulated world.
        name: name of the session; by default session_00 and so on.
    """

    def __init__(
        self,
        settings: AnySimulationSettings | None = None,
        seed: int = 0,
        session: int = 0,
        *,
        resolution: Resolution = FINE,
        name: str = "",
    ) -> None:
        """Stores the arguments; parameters, trajectory and images are computed when they are needed."""
        self.preset_settings = settings or SimulationSettings()
        """The settings as given, from which the parameters of the session are drawn."""
        self.settings = settings_of_session(self.preset_settings, seed, session)
        """The settings of this session, with its camera."""
        self.seed, self.number, self.resolution = seed, session, resolution
        self.name = name or f"session_{session:02d}"
        self.clock: Clock = SimulatedClock()
        """Simulated time on the camera's clock: the time of the event that was yielded last."""

    def _rng(self, purpose: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, self.number, purpose])

    @property
    def _first_of_bench(self) -> int:
        """The first session on this session's bench. All sessions of a bench share the camera and the scene."""
        return self.number - self.number % self.settings.world.sessions_per_bench

    def _bench_rng(self, purpose: int) -> np.random.Generator:
        """Returns the same random numbers for all sessions of a bench."""
        return np.random.default_rng([self.seed, self._first_of_bench, purpose])

    def _catheter_rng(self) -> np.random.Generator:
        """Returns the same random numbers for all sessions of a catheter."""
        number = self.number // self.settings.world.shaft.sessions_per_catheter
        return np.random.default_rng([self.seed, number, 9])

    @cached_property
    def session(self) -> Session:
        """The session's parameters and trajectory: the ground truth."""
        return run_session(self.preset_settings.world, self.seed, self.number, self.resolution)

    @property
    def trajectory(self) -> Trajectory:
        """The trajectory, instant by instant."""
        return self.session.trajectory

    @cached_property
    def imaging(self) -> Imaging:
        """The cameras or the fluoroscope of the bench."""
        times, kept = self._exposures
        shown = np.flatnonzero(kept.any(axis=1))
        return make_imaging(
            self.settings,
            self.session,
            (self._bench_rng(2), self._catheter_rng()),
            self.interpolator.exposure,
            times,
            shown,
            first_frame=(self.number - self._first_of_bench) * _MAX_FRAMES,
        )

    @property
    def views(self) -> tuple[str, ...]:
        """Names of the images' streams."""
        return view_names(self.settings)

    @property
    def has_knob(self) -> bool:
        """Whether the device can be steered; a guidewire cannot."""
        return self.settings.world.actuation.gain_per_m_deg > 0.0

    @property
    def has_joints(self) -> bool:
        """Whether any drive of the device is read."""
        return self.has_knob or self.settings.world.clamp.logged

    @cached_property
    def readings(self) -> Readings:
        """All readings except the images."""
        readings = Readings(self.session.bench_model, self.interpolator.place, self._rng(3))
        readings.take(self.trajectory, self._rows_known())
        return readings

    def _rows_known(self) -> int:
        """Returns the number of the trajectory's instants that are known."""
        return self.trajectory.time_s.size

    @property
    def log(self) -> SensorLog:
        """All readings of the force sensor, on its own clock."""
        return self.readings.log

    @cached_property
    def _exposures(self) -> tuple[FloatArray, BoolArray]:
        """(m,) middle of each exposure, and (m, views) whether its image arrived."""
        clock, rng = self.settings.world.clock, self._rng(4)
        count = round(self.settings.world.seconds * clock.fps)
        max_jitter_s = min(3.0 * clock.jitter_s, 0.45 / clock.fps)  # less than half a period: the frames stay in order
        jitter_s = np.clip(rng.standard_normal(count) * clock.jitter_s, -max_jitter_s, max_jitter_s)
        jitter_s[0] = abs(jitter_s[0])  # no stamp is before zero
        arrived = rng.random((len(self.views), count)) >= clock.dropped_share
        arrived &= np.arange(count) / clock.fps >= clock.images_from_s
        return np.arange(count) / clock.fps + jitter_s, arrived.T

    @property
    def _shown(self) -> BoolArray:
        """(m,): exposures of which at least one view's image arrived."""
        return np.asarray(self._exposures[1].any(axis=1), np.bool_)

    @cached_property
    def frame_s(self) -> FloatArray:
        """(n,) middle of each exposure of the first view, of the frames that were not dropped in all views."""
        return self._exposures[0][self._shown]

    def arrived(self, view: str) -> IntArray:
        """Returns the indices (k,) of the frames (0 to n - 1) that were not dropped in ``view``."""
        return self._arrived[self.views.index(view)]

    @cached_property
    def _arrived(self) -> tuple[IntArray, ...]:
        return tuple(np.flatnonzero(column) for column in self._exposures[1][self._shown].T)

    @property
    def stamp_ns(self) -> IntArray:
        """(n,) the frames' stamps in the first view."""
        return np.round(self.frame_s * 1e9).astype(np.int64)

    @cached_property
    def interpolator(self) -> TrajectoryInterpolator:
        """The trajectory at any time."""
        return TrajectoryInterpolator(self.trajectory, self.session.bench_model, self.resolution)

    def delay_ns(self, view: str) -> int:
        """Returns how much later the exposures of ``view`` are than those of the first view, see `stamp_ns`."""
        return round(1e9 * view_delays_s(self.settings)[view])

    def frame(self, index: int, view: str = "") -> Frame:
        """Returns an image.

        Args:
            index: number of the frame, 0 to n - 1.
            view: one of `views`; "": the first.

        Returns:
            The image with its stamp on the camera's clock.
        """
        view = view or self.views[0]
        return Frame(int(self.stamp_ns[index]) + self.delay_ns(view), self.imaging.image(view, index), view)

    def image_truth(self, index: int, view: str = "") -> ImageTruth:
        """Returns the ground truth of an image.

        Args:
            index: number of the frame, 0 to n - 1.
            view: one of `views`; "": the first.

        Returns:
            The catheter in the image.
        """
        return self.imaging.truth(view or self.views[0], index)

    def stage_log(self) -> tuple[IntArray, dict[str, FloatArray]]:
        """Returns stamps (k,) and the commanded positions of the stage's axes in mm."""
        stage = self.readings.stage
        return stage.stamp_ns, dict(zip(stage.names, stage.values.T, strict=True))

    def knob_log(self) -> tuple[IntArray, FloatArray]:
        """Returns stamps (k,) and the knob's reading in degrees (k,)."""
        joints = self.readings.joints
        return joints.stamp_ns, joints.values[:, 0]

    def schedule(self) -> list[tuple[int, int, int]]:
        """Returns all events in the order of their arrival: (time on the camera's clock in ns, stream, row).

        ``stream`` and ``row`` are the arguments of `event`. Events that arrive at the same time keep the order of their
        streams.
        """
        readings = self.readings
        force_ns = np.round(readings.log.true_s * 1e9).astype(np.int64)
        joints_ns = readings.joints.stamp_ns if self.has_joints else np.empty(0, np.int64)
        images = [self.stamp_ns[self.arrived(view)] + self.delay_ns(view) for view in self.views]
        stamps = (force_ns, readings.stage.stamp_ns, joints_ns, *images)
        *drives, image_delay = self._delays_ns()
        delays = (*drives, *(image_delay for _ in images))
        arrival = np.concatenate([stream_ns + delay_ns for stream_ns, delay_ns in zip(stamps, delays, strict=True)])
        stream = np.repeat(np.arange(len(stamps)), [len(stream_ns) for stream_ns in stamps])
        row = np.concatenate([np.arange(len(stream_ns)) for stream_ns in stamps])
        order = np.argsort(arrival, kind="stable")
        return list(zip(arrival[order].tolist(), stream[order].tolist(), row[order].tolist(), strict=True))

    def _delays_ns(self) -> tuple[int, ...]:
        """Returns the delays of force, stage, joints and images: 0 in a recording, which has true times."""
        return (0, 0, 0, 0)

    def event(self, stream: int, row: int) -> Event:
        """Returns the event of one entry of `schedule`.

        Args:
            stream: 0 for force, 1 for stage, 2 for joints, 3 and up for the images of each view.
            row: number of the reading or image in its stream.

        Returns:
            A force reading, an actuation or an image.
        """
        readings = self.readings
        match stream:
            case 0:
                return readings.wrench(row)
            case 1:
                return readings.actuation(readings.stage, row)
            case 2:
                return readings.actuation(readings.joints, row)
            case _:
                view = self.views[stream - 3]
                return self.frame(int(self.arrived(view)[row]), view)

    def __iter__(self) -> Iterator[Event]:
        for at_ns, stream, row in self.schedule():
            self.clock.sleep_until_ns(at_ns)
            yield self.event(stream, row)

    @property
    def session_info(self) -> SessionInfo:
        """The session's public metadata: the values that a person at the bench would know."""
        return self._session_info

    @cached_property
    def _session_info(self) -> SessionInfo:
        """The public metadata, rounded as a person would write them down; nominal values where there are some."""
        world, device = self.settings.world, self.session.bench_model.parameters.device
        imaging, gain = self.imaging, world.actuation.gain_per_m_deg
        metres_per_px = float(f"{imaging.measured_scale_m_per_px(self._bench_rng(5)):.4g}")
        of_length, of_stiffness = world.shaft.uncertainties()
        return SessionInfo(
            name=self.name,
            catheter=Catheter(
                name=world.shaft.name,
                diameter_m=device.nominal_diameter_m or device.diameter_m,
                flexible_length_m=device.nominal_flexible_length_m,
                rigid_length_m=world.shaft.rigid_length_m,
                bending_stiffness_nm2=device.nominal_stiffness_nm2,
                stiffness_profile=world.shaft.stiffness_knots,
                rest_curvature_per_m=world.shaft.rest_curvature_per_m,
                flexible_length_uncertainty=of_length,
                bending_stiffness_uncertainty=of_stiffness,
            ),
            views={view: imaging.view_info(view, metres_per_px) for view in self.views},
            sensor=SensorInfo(
                angle_deg=float(f"{self.log.nominal_angle_deg:g}"),
                reads="tip-on-tissue",
                no_contact_s=(0.0, float(f"{world.tare_s:g}")),
                moving_mass_kg=float(f"{world.sensor.moving_mass_kg:g}"),
            ),
            actuation=ActuationInfo(knob_gain_per_m_deg=float(f"{gain:g}") if gain else None),
            tissue=TissueInfo(self._stated_tissue_n_per_m()),
            stage=StageInfo(clock="camera"),
            simulated=True,
            preset=self.settings.preset,
        )

    def _stated_tissue_n_per_m(self) -> float | None:
        """Returns the stiffness of the tissue with the error of an earlier measurement; None: it is not stated."""
        relative_sd = self.settings.world.wall.stated_within
        if relative_sd is None:
            return None
        error_factor = math.exp(relative_sd * self._rng(12).standard_normal())
        return float(f"{self.session.bench_model.parameters.wall_stiffness_n_per_m * error_factor:.3g}")

    def values(self) -> dict[str, Any]:
        """Returns all drawn and solved parameters of the session, by name; names end in the unit."""
        session, log = self.session, self.log
        parameters = asdict(session.bench_model.parameters)
        drawn = parameters.pop("device") | parameters
        return {
            **{name: value for name, value in drawn.items() if value is not None},
            **asdict(session.motion),
            "wall_normal": session.bench_model.wall.normal.tolist(),
            "forward": session.bench_model.forward.tolist(),
            "bias_n": log.bias_n.tolist(),
            "drift_n_per_s": log.drift_n_per_s.tolist(),
            "redraws": session.redraws,
            **self.imaging.values(),
        }
