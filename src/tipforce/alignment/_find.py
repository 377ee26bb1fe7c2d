"""Tare and inertia of a force log, found or as a person states them."""

from dataclasses import dataclass, field
from typing import Literal

from ..io import Inertia, Tare
from ..plausibility import ForcePlausibility
from ..types import FloatArray, IntArray, SensorInfo
from ._inertia import StageMotion, carried_n, fit_inertia
from ._tare import find_tare, stated_tare

TareChoice = Literal["auto", "none"] | tuple[float, float]
"""Found; nothing subtracted; or from and to, in seconds of the force log."""


@dataclass(frozen=True, slots=True, eq=False)
class ForceCorrections:
    """How the force log of a run is read: everything but its clock. ``sensor``: None where nobody stated its pose."""

    sensor: SensorInfo | None
    tare: Tare
    inertia: Inertia
    stage: StageMotion
    plausibility: ForcePlausibility = field(default_factory=ForcePlausibility)

    def carried(self, stamps_ns: IntArray) -> FloatArray:
        """(n, 3) N, or (3,) zeros: what readings at ``stamps_ns`` show of the mass that the sensor carries."""
        return carried_n(self.stage, self.inertia, stamps_ns)


def find_tare_and_inertia(
    stamps: IntArray, force: FloatArray, stage: StageMotion, choice: TareChoice, remarks: list[str]
) -> tuple[Tare, Inertia]:
    """Tare and inertia of the readings (n, 3); adds to ``remarks`` what a person should know of them."""
    if choice == "none":
        return Tare(), Inertia()
    if not isinstance(choice, str):
        if not stage.names:
            return stated_tare(stamps, force, *choice), Inertia()
        tare, inertia = fit_inertia(stamps, force, stage, choice)
        if inertia.how == "none":
            remarks.append(inertia.detail)
        return tare, inertia
    tare = find_tare(stamps, force)
    if tare.how == "none":
        remarks.append(f"the force is not tared: {tare.detail}")
    elif stage.names:
        return fit_inertia(stamps, force, stage, max(tare.stretches_s, key=lambda stretch: stretch[1] - stretch[0]))
    return tare, Inertia()
