"""From the knob at the handle to the shaft's pre-curvature."""

from numpy.typing import ArrayLike

from ...types import FloatArray
from ._play import Hysteresis, Play, row_of
from ._tendon import Tendon

__all__ = ["KnobMap"]


class KnobMap:
    """Knob angle -> hysteresis of the handle -> (tendon ->) curvature.

    ``curvature_per_m_per_deg``: nominal slope, 0.533 (1/m) per degree: 48 1/m at a full turn of 90 degrees.
    ``hysteresis`` works on degrees; by default `Play` of 1 degree. With a ``tendon`` the knob winds up the pull that
    gives the nominal curvature without friction, and the tendon's stretch and friction do the rest; without one the
    wire is taken as stiff and free of friction, and a knob turned the other way bends the other way.

    >>> knob = KnobMap()
    >>> round(knob.step(10.0), 4), round(knob.step(9.5), 4)
    (5.0635, 5.0635)
    """

    def __init__(
        self,
        curvature_per_m_per_deg: float = 0.533,
        hysteresis: Hysteresis | None = None,
        tendon: Tendon | None = None,
    ) -> None:
        self.curvature_per_m_per_deg = curvature_per_m_per_deg
        self.hysteresis: Hysteresis = Play(1.0) if hysteresis is None else hysteresis
        self.tendon = tendon

    def step(self, knob_deg: float) -> float:
        """The knob's next angle -> curvature in 1/m."""
        return float(self.run([knob_deg])[0])

    def run(self, knob_deg: ArrayLike) -> FloatArray:
        """(n,) angles of the knob in their order -> (n,) curvatures in 1/m; the same as n times `step`."""
        curvature = self.curvature_per_m_per_deg * self.hysteresis.run(row_of(knob_deg))
        return curvature if self.tendon is None else self.tendon.run(self.tendon.pull_m(1.0) * curvature)[0]
