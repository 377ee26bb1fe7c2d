"""Contact state of the run, with a force-time integral that a person starts and stops."""

from dataclasses import replace

from ..clinical import ClinicalState, ContactMonitor, ContactSettings, ContactState, probability_above
from ..types import ForceEstimate


class ContactTotals:
    """`ContactMonitor` with buttons: ``start`` resets times and integral, ``stop`` keeps the integral as it is."""

    def __init__(self, settings: ContactSettings) -> None:
        self._monitor = ContactMonitor(settings)
        self._held: tuple[float, tuple[float, float]] | None = (0.0, (0.0, 0.0))
        self._last: ClinicalState | None = None

    @property
    def running(self) -> bool:
        """Whether the integral is running."""
        return self._held is None

    @property
    def settings(self) -> ContactSettings:
        """Force window, limit and contact threshold."""
        return self._monitor.settings

    @settings.setter
    def settings(self, settings: ContactSettings) -> None:
        """Changes the thresholds from the next estimate on; the times that were counted before are kept."""
        self._monitor.settings = settings

    def start(self) -> None:
        """Resets times and integral, and starts the integral."""
        self._monitor.reset()
        self._held = None

    def stop(self) -> None:
        """Keeps the integral at its present value."""
        if self.running:
            last = self._last
            self._held = (0.0, (0.0, 0.0)) if last is None else (last.integral_n_s, last.integral_interval_n_s)

    def update(self, estimate: ForceEstimate, raw: ForceEstimate) -> ClinicalState:
        """Takes the next estimate.

        Args:
            estimate: the estimate after the operator's zero was subtracted.
            raw: the same estimate as the method returned it.

        Returns:
            The contact state after this estimate. The larger of both forces is compared with the limit: a zero that was
            taken in contact must not hide a large force. The integral is the kept one while it is stopped.
        """
        state = self._monitor.update(estimate)
        if raw is not estimate and raw.valid:
            limit_n = self.settings.limit_n
            if raw.magnitude_n > limit_n:
                state = replace(state, contact=ContactState.EXCESSIVE)
            above = probability_above(raw, limit_n)
            if not above <= state.above_limit:  # also where the state's probability is NaN
                state = replace(state, above_limit=above)
        if self._held is not None:
            state = replace(state, integral_n_s=self._held[0], integral_interval_n_s=self._held[1])
        self._last = state
        return state
