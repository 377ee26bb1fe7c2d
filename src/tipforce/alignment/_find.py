"""Tare and inertia of a force log, found or as a person states them."""

from dataclasses import dataclass, field
from typing import Literal

from ..io import Inertia, Tare
from ..plausibility import ForcePlausibility
from ..types import FloatArray, IntArray, SensorInfo
from ._beat import add_beat
from ._inertia import StageMotion, carried_n, fit_inertia
from ._tare import find_tare, stated_tare

TareChoice = Literal["auto", "none"] | tuple[float, float]
"""Found; nothing subtracted; or from and to, in seconds of the force log."""


@dataclass(frozen=True, slots=True, eq=False)
class ForceCorrections:
    """Corrections of a run's force log: everything except its clock.

    Attributes:
        sensor: metadata of the sensor; None: its pose is not stated.
        tare: reading without contact.
        inertia: inertia of the carried mass.
        stage: movement of the stage.
        plausibility: implausible readings.
    """

    sensor: SensorInfo | None
    tare: Tare
    inertia: Inertia
    stage: StageMotion
    plausibility: ForcePlausibility = field(default_factory=ForcePlausibility)

    def carried(self, stamps_ns: IntArray) -> FloatArray:
        """Returns (n, 3) N, or (3,) zeros: the inertia of the carried mass in readings at ``stamps_ns``."""
        return carried_n(self.stage, self.inertia, stamps_ns)


def find_tare_and_inertia(
    stamps: IntArray,
    force: FloatArray,
    stage: StageMotion,
    choice: TareChoice,
    remarks: list[str],
    moving_mass_kg: float | None = None,
) -> tuple[Tare, Inertia]:
    """Finds tare and inertia of a force log.

    Args:
        stamps: (n,) stamps of the readings.
        force: (n, 3) readings, N; NaN where there is no plausible one.
        stage: movement of the stage; empty without its log.
        choice: the tare as it is stated, or "auto".
        remarks: sentences for the user are added to it.
        moving_mass_kg: the stated mass that moves with the sensor; without the stage's log the inertia is looked for
            only where it is stated.

    Returns:
        Tare and inertia; the reason in the inertia's ``detail`` where it cannot be removed.
    """
    if choice == "none":
        return Tare(), Inertia()
    inertia = Inertia()
    if isinstance(choice, str):
        tare = find_tare(stamps, force)
        if tare.how == "none":
            remarks.append(f"the force is not tared: {tare.detail}")
            return tare, inertia
        stretch = max(tare.stretches_s, key=lambda stretch: stretch[1] - stretch[0])
    else:
        stretch = choice
        tare = Tare() if stage.names else stated_tare(stamps, force, *stretch)
    if stage.names:
        tare, inertia = fit_inertia(stamps, force, stage, stretch)
        if inertia.how == "none" and not isinstance(choice, str):
            remarks.append(inertia.detail)
    if stage.names or moving_mass_kg:
        tare, inertia = add_beat(stamps, force, stage, tare, inertia)
    return tare, inertia
