"""Compensation of the viscous part of the force, which no single image shows, by the rate of change of the estimate.

An image shows the indentation of the tissue, and the elastic force follows from that. The viscous part leads it in
phase, by the loss factor over the angular frequency: 23 ms in tissue of loss factor 0.175 at 1.2 Hz. Its size follows
from the change of the estimate since an earlier frame.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...types import FloatArray, IntArray
from ._calibration import CalibrationBatch

MIN_ELAPSED_S, MAX_ELAPSED_S = 0.03, 0.15
"""Time over which the change is taken: less is noise, more is another phase of the heartbeat."""

MAX_COMPENSATION_S = 10.0
"""Largest value of a compensation. Those of tissue are tens of milliseconds; a longer one is fitted where the network
estimates nearly the same force in all images."""
_PRIOR_SAMPLES = 200.0
"""Weight of the initial model's compensation, or of none, in samples."""
_MAX_PAIRS = 20_000
"""About the largest number of pairs of samples for the fit, at most twice as many."""


@dataclass(frozen=True, eq=False)
class RateCompensation:
    """The compensated force is force (t,) + rate of change (t,) @ ``seconds`` (t, t).

    Attributes:
        seconds: (t, t) time constants in s.
        sigma_factor_without_history: ratio of the error without an earlier frame to that with one.
    """

    seconds: FloatArray
    sigma_factor_without_history: float

    @property
    def used(self) -> bool:
        """Whether earlier frames matter at all."""
        return bool(self.seconds.any())


class History:
    """The last estimates of one session."""

    def __init__(self) -> None:
        self._past: deque[tuple[int, FloatArray]] = deque()

    def rate(self, stamp_ns: int, force_n: FloatArray) -> FloatArray | None:
        """Returns the rate of change of the force; keeps the force for later calls.

        The earlier frame is the newest one that is at least `MIN_ELAPSED_S` and at most `MAX_ELAPSED_S` old.

        Args:
            stamp_ns: stamp of the frame.
            force_n: (t,) its force in newtons.

        Returns:
            (t,) in N/s; None without a suitable earlier frame.
        """
        past, rate_n_per_s = self._past, None
        while past and not 0 <= stamp_ns - past[0][0] <= MAX_ELAPSED_S * 1e9:
            past.popleft()  # too old, or of a clock that was set back
        while len(past) > 1 and stamp_ns - past[1][0] >= MIN_ELAPSED_S * 1e9:
            past.popleft()  # the next one is old enough, too
        if past and stamp_ns - past[0][0] >= MIN_ELAPSED_S * 1e9:
            rate_n_per_s = (force_n - past[0][1]) / (1e-9 * (stamp_ns - past[0][0]))
        past.append((stamp_ns, force_n))
        return rate_n_per_s


def rate_compensation_from(calibration: CalibrationBatch, initial: RateCompensation | None) -> RateCompensation:
    """Fits the compensation on all samples that have an earlier one in their session; see `fit_rate_compensation`.

    Args:
        calibration: the trained graph with its samples.
        initial: compensation of the initial model; None: it has none.

    Returns:
        The compensation; ``initial``, or none, where no sample has an earlier one.
    """
    earlier = earlier_samples(calibration.stamp_ns, calibration.samples.session)
    later = np.flatnonzero(earlier >= 0)
    later = later[:: max(1, len(later) // _MAX_PAIRS)]
    earlier = earlier[later]
    outputs = calibration.samples.force_n.shape[1]
    if initial is None or initial.seconds.shape != (outputs, outputs):
        initial = RateCompensation(np.zeros((outputs, outputs)), 1.0)
    if not len(later):
        return initial
    later_n, earlier_n = (
        calibration.at(index, names=("force_n",))["force_n"].astype(np.float64) for index in (later, earlier)
    )
    elapsed_s = 1e-9 * (calibration.stamp_ns[later] - calibration.stamp_ns[earlier])
    rate = (later_n - earlier_n) / elapsed_s[:, None]
    return fit_rate_compensation(later_n, rate, calibration.samples.force_n[later].astype(np.float64), initial)


def earlier_samples(stamp_ns: IntArray, session: npt.NDArray[np.str_]) -> IntArray:
    """Returns for each sample the latest one of its session that is older by `MIN_ELAPSED_S` to `MAX_ELAPSED_S`.

    `History` takes the same one. The samples may come in any order.

    Args:
        stamp_ns: (n,) stamps, ns.
        session: (n,) sessions.

    Returns:
        (n,) indices, -1 for none.
    """
    earlier = np.full(len(stamp_ns), -1, np.int64)
    order = np.lexsort((stamp_ns, session))  # by session, then by stamp
    for rows in np.split(order, np.flatnonzero(session[order][1:] != session[order][:-1]) + 1):
        stamps = stamp_ns[rows]
        index = np.searchsorted(stamps, stamps - int(MIN_ELAPSED_S * 1e9), side="right") - 1
        near = (index >= 0) & (stamps - stamps[np.maximum(index, 0)] <= MAX_ELAPSED_S * 1e9)
        earlier[rows[near]] = rows[index[near]]
    return earlier


def fit_rate_compensation(
    estimate_n: FloatArray, rate: FloatArray, truth_n: FloatArray, initial: RateCompensation
) -> RateCompensation:
    """Fits the compensation by regularised least squares.

    Args:
        estimate_n: (n, t) estimates from single images in newtons.
        rate: (n, t) rates of their change in N/s.
        truth_n: (n, t) labels in newtons.
        initial: the fit is regularised towards this one, with the weight of `_PRIOR_SAMPLES` samples.

    Returns:
        The compensation; ``initial`` where nothing changes or the fit is beyond `MAX_COMPENSATION_S`.
    """
    if not rate.any():
        return initial
    error_n = truth_n - estimate_n
    prior = _PRIOR_SAMPLES * float(np.mean(rate * rate)) * np.eye(estimate_n.shape[1])
    solution = np.linalg.solve(rate.T @ rate + prior, rate.T @ error_n + prior @ initial.seconds)
    seconds = solution.astype(np.float64)
    if not np.abs(seconds).max() <= MAX_COMPENSATION_S:
        return initial
    remaining_n = error_n - rate @ seconds
    factor = max(1.0, float(np.sqrt(np.mean(error_n**2) / max(np.mean(remaining_n**2), 1e-12))))
    return RateCompensation(seconds, factor)
