"""Priors of the rod learnt from sessions with forces, by expectation and maximisation over sessions.

Expectation: in each session the force is the reading of the sensor, and the constants' posterior follows frame by frame
(an iterated extended Kalman filter on the rod). Maximisation: mean and covariance of the constants over the sessions,
with the settings' prior counted as `_WEIGHT` further sessions.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..._system.rows import evenly_spread
from ...datasets import Dataset, calibration_images
from ...errors import InputError
from ...mechanics.planar import FORCE, UNKNOWNS, Line, fit_line, make_work
from ...types import FloatArray, SessionInfo
from ...vision import detector_kind
from .._base import Progress
from .._reading import Abstention
from ._detection import Detection
from ._knowledge import Knowledge, noise_unit_m, rod_model
from ._line_error import MODES, LineError
from ._lines import POINTS
from ._settings import RodSettings

_FRAMES = 48
"""Number of frames of each session, spread over it."""
_STATED = ("length", "scale", "tilt_x_per_m", "tilt_y_per_m", "distortion_per_m2", "creep")
"""Constants of which the settings' priors stay: they state how well a bench is measured; the image has little
information on them."""
_ROUNDS = 3
_WEIGHT = 2.0
_SENSOR_STD_N = 8e-3
"""Noise, pose and tare of a bench's force sensor."""
_CONTACT_N = 0.02
_HUBER, _STEPS = 4.0, 20
_MOST_MISFIT = 10.0
"""A frame whose misfit is larger than the limit of an estimate by this factor is left out: its line is wrong."""
_LEAST_SHARE = 0.05


@dataclass(frozen=True, eq=False)
class _Session:
    info: SessionInfo
    lines: Sequence[Line]
    scale: float
    knob_deg: FloatArray
    force_n: FloatArray


def learn(settings: RodSettings, dataset: Dataset, progress: Progress) -> Knowledge:
    """Learns the priors of the constants from sessions with measured forces.

    Args:
        settings: the settings; their priors are the start.
        dataset: the sessions.
        progress: called with the current work and its finished share.

    Raises:
        InputError: the forces lack x or y, or the catheter is found in no image.
    """
    if not dataset.known[:2].all():
        raise InputError(f"{dataset.title}: to learn from it the rod needs forces in x and y; state learn=false")
    sessions: list[_Session] = []
    for k, name in enumerate(dataset.sessions):
        progress("detecting the catheter", 0.7 * k / len(dataset.sessions))
        sessions.append(_read(settings, dataset, name))
    sessions = [each for each in sessions if each.lines]
    if not sessions:
        raise InputError(f"{dataset.title}: the catheter is found in no image; look at one with `tipforce inspect`")
    stated = Knowledge.stated(settings)
    knowledge = stated
    for turn in range(_ROUNDS):
        progress("learning the priors", 0.7 + 0.3 * turn / _ROUNDS)
        posteriors = [_posterior(settings, knowledge, session) for session in sessions]
        means, covariances = [mean for mean, _ in posteriors], [covariance for _, covariance in posteriors]
        knowledge = _maximised(settings, stated, knowledge, sessions, means, covariances)
    progress("learning the priors", 1.0)
    return knowledge


def _read(settings: RodSettings, dataset: Dataset, name: str) -> _Session:
    """Detects the catheter in up to `_FRAMES` frames of the session ``name``; frames without a line are left out."""
    info = dataset.session_info[name]
    rows = np.flatnonzero(dataset.session == name)
    frames = dataset.subset(rows[evenly_spread(len(rows), _FRAMES)])
    images = (
        calibration_images(dataset, name, settings.vision.view)
        if detector_kind(settings.vision.method).by_session
        else ()
    )
    detection = Detection(settings.vision, info, images)
    lines: list[Line] = []
    knobs: list[float] = []
    forces: list[FloatArray] = []
    scale = 0.0
    for observation, force in zip(frames.observations(), frames.force_n, strict=True):
        found = detection.read(observation)
        if not isinstance(found, Abstention) and found.shape.centreline is not None:
            lines.append(found.line())
            knobs.append(observation.actuation.get("knob_deg", np.nan))
            forces.append(force[:FORCE])
            scale = found.frame.scale_m_per_px
    return _Session(info, lines, scale, np.array(knobs), np.array(forces).reshape(-1, FORCE))


def _posterior(settings: RodSettings, knowledge: Knowledge, session: _Session) -> tuple[FloatArray, FloatArray]:
    """Returns mean (constants,) and covariance (constants, constants) of a session's constants (the expectation step).

    Frame by frame, the line is fitted with the measured force and the posterior of the frames before as the prior.
    The pre-curvature of the result is that beside the knob's.
    """
    error = LineError.of(settings.noise, MODES)
    constants = len(UNKNOWNS) - FORCE
    count = len(UNKNOWNS) + MODES  # force, constants, lasting errors of the line
    model = rod_model(session.info, settings.segments)
    unit = noise_unit_m(model, session.scale)
    modes, whiten = error.modes * unit, error.whiten / unit
    work = make_work(model, POINTS, count)
    mean, covariance = np.zeros(count - FORCE), np.eye(count - FORCE)
    mean[:constants], covariance[:constants, :constants] = knowledge.for_session(
        settings, session.info, session.knob_deg[0]
    )
    fitted_covariance = np.zeros((count, count))
    gain = session.info.actuation.knob_gain_per_m_deg or 0.0
    for k, line in enumerate(session.lines):
        mean[0] += gain * float(np.nan_to_num(session.knob_deg[k] - session.knob_deg[max(k - 1, 0)]))
        information = np.zeros((count, count))
        information[:FORCE, :FORCE] = np.eye(FORCE) / _SENSOR_STD_N**2
        information[FORCE:, FORCE:] = np.linalg.inv(covariance)
        prior_mean = np.concatenate([session.force_n[k], mean])
        q = prior_mean.copy()
        if k == 0:  # start with the clamp at the first point
            base = UNKNOWNS.index("base_x_m")
            q[base : base + 2] = line.points[0]
        found = fit_line(
            q, prior_mean, information, model, line, modes, whiten, _HUBER, _STEPS, True, work, fitted_covariance
        )  # fmt: skip
        if not found.converged or found.chi2 > _MOST_MISFIT * settings.max_misfit * (POINTS + 1):
            continue
        mean, covariance = q[FORCE:].copy(), 0.5 * (fitted_covariance + fitted_covariance.T)[FORCE:, FORCE:]
    relative = mean[:constants].copy()
    relative[0] -= session.info.actuation.curvature_per_m(float(session.knob_deg[-1])) or 0.0
    return relative, covariance[:constants, :constants]


def _maximised(
    settings: RodSettings,
    stated: Knowledge,
    knowledge: Knowledge,
    sessions: Sequence[_Session],
    means: Sequence[FloatArray],
    covariances: Sequence[FloatArray],
) -> Knowledge:
    """Returns the priors that fit the sessions' posteriors best (the maximisation step).

    Each session's posterior is one of ``means`` (constants,) and one of ``covariances`` (constants, constants).
    The priors of the settings, ``stated``, count as `_WEIGHT` further sessions.
    """
    count = len(means)
    stated_covariance = stated.for_session(settings, sessions[0].info, sessions[0].knob_deg[0])[1]
    mean = (np.sum(means, axis=0) + _WEIGHT * stated.constants) / (count + _WEIGHT)
    squares = [np.outer(each - mean, each - mean) for each in (*means, stated.constants)]
    spread = np.sum(squares[:-1], axis=0) + np.sum(covariances, axis=0) + _WEIGHT * (stated_covariance + squares[-1])
    covariance = spread / (count + _WEIGHT)
    force = np.concatenate([each.force_n for each in sessions])
    touching = np.linalg.norm(force, axis=1) > _CONTACT_N
    not_learnt = [UNKNOWNS.index(name) - FORCE for name in _STATED]
    mean[not_learnt] = stated.constants[not_learnt]
    covariance[not_learnt] = covariance[:, not_learnt] = 0.0
    covariance[not_learnt, not_learnt] = stated_covariance[not_learnt, not_learnt]
    return replace(
        knowledge,
        constants=mean,
        constants_covariance=covariance,
        contact_share=float(np.clip(touching.mean(), _LEAST_SHARE, 1.0 - _LEAST_SHARE)),
        sessions=count,
    )
