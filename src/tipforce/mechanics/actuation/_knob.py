"""From the knob at the handle to the pre-curvature: the pull wire, with stretch and friction, and the whole map."""

import math

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from ...types import FloatArray
from ._hysteresis import Hysteresis, Play, row_of


class Tendon:
    """A wire off the shaft's axis that bends it to an arc when it is pulled at the handle; nothing acts on the tip.

    At the tip the wire's tension T_d bends the shaft: T_d ``offset_m`` = EI curvature. Bending takes up
    ``offset_m`` x ``length_m`` x curvature of the pull, the wire's stretch ``compliance_m_per_n`` x T takes up the
    rest, T being the tension at the handle. In between lies the sheath, which turns by ``wrap_rad`` in all and rubs
    with Coulomb's ``friction`` mu: the wire sticks as long as exp(-mu wrap) <= T_d / T <= exp(mu wrap) (capstan; its
    mass and the friction inside the bent section are left out). It cannot push: below zero pull it is slack.

    For every pull the curvature thus lies between two lines through the origin and moves only when it would leave them:
    it lags by the same share whatever the speed. Defaults: 1.1 mm offset; 1.1e-4 m/N, a steel wire of 1.1 m
    and 0.25 mm. Raises ValueError where a number has no meaning.

    >>> tendon = Tendon(length_m=0.04, stiffness_nm2=4.3e-4)
    >>> round(tendon.step(0.5e-3), 3), round(tendon.tension_n, 3)
    (5.747, 2.247)
    """

    def __init__(
        self,
        length_m: float,
        stiffness_nm2: float,
        offset_m: float = 1.1e-3,
        compliance_m_per_n: float = 1.1e-4,
        friction: float = 0.0,
        wrap_rad: float = 0.0,
    ) -> None:
        if not (length_m > 0 and stiffness_nm2 > 0 and offset_m > 0 and compliance_m_per_n > 0):
            raise ValueError("a tendon needs a positive length, stiffness, offset and compliance")
        if not (friction >= 0 and wrap_rad >= 0 and math.isfinite(friction * wrap_rad)):
            raise ValueError(f"friction, wrap_rad: expected 0 or more, got {friction}, {wrap_rad}")
        self.length_m = length_m
        self.stiffness_nm2 = stiffness_nm2
        self.offset_m = offset_m
        self.compliance_m_per_n = compliance_m_per_n
        self.friction = friction
        self.wrap_rad = wrap_rad
        self.curvature_per_m = 0.0
        self.tension_n = 0.0

    @property
    def tip_tension_n(self) -> float:
        """Tension where the wire ends, behind all friction."""
        return self.stiffness_nm2 * self.curvature_per_m / self.offset_m

    def pull_m(self, curvature_per_m: float) -> float:
        """Pull at the handle that would give this curvature without friction."""
        return self._takes_up_m2(1.0) * curvature_per_m

    def step(self, pull_m: float) -> float:
        """The next pull at the handle -> curvature in 1/m; `tension_n` is what a sensor at the handle reads."""
        return float(self.run([pull_m])[0][0])

    def run(self, pull_m: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """(n,) pulls in their order -> (n,) curvatures in 1/m and (n,) tensions at the handle in N."""
        pulls = row_of(pull_m)
        curvature, tension = np.empty_like(pulls), np.empty_like(pulls)
        rub = math.exp(self.friction * self.wrap_rad)
        self.curvature_per_m = _integrate(
            pulls,
            1.0 / self._takes_up_m2(rub),
            1.0 / self._takes_up_m2(1.0 / rub),
            self.offset_m * self.length_m,
            self.compliance_m_per_n,
            self.curvature_per_m,
            curvature,
            tension,
        )
        if pulls.size:
            self.tension_n = float(tension[-1])
        return curvature, tension

    def _takes_up_m2(self, rub: float) -> float:
        """Pull over curvature while the wire slides, with T = ``rub`` T_d."""
        stretch = self.compliance_m_per_n * rub * self.stiffness_nm2 / self.offset_m
        return self.offset_m * self.length_m + stretch


@njit(cache=True, nogil=True, error_model="numpy")
def _integrate(
    pulls: FloatArray,
    pulling: float,
    letting_go: float,
    bending_m2: float,
    compliance: float,
    now: float,
    curvature: FloatArray,
    tension: FloatArray,
) -> float:
    """``pulling``, ``letting_go``: slopes of the two lines curvature over pull. Returns the last curvature."""
    for i in range(pulls.size):
        pull = max(0.0, pulls[i])
        now = max(pulling * pull, min(letting_go * pull, now))
        curvature[i] = now
        tension[i] = max(0.0, pull - bending_m2 * now) / compliance
    return now


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
