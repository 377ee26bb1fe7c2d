"""What is publicly known of a catheter and of a session: the sheet of paper beside the bench."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

__all__ = ["BASE_SIDE", "BASE_SIDES", "CATHETER_FACTS", "KNOB_GAIN", "Catheter", "Context"]

BASE_SIDE, KNOB_GAIN = "base_side", "knob_gain_per_m_deg"
"""Notes of a `Context`: the border of the picture that the base lies at; the curvature that a degree of the knob asks
for."""

BASE_SIDES = ("left", "right", "top", "bottom")


@dataclass(frozen=True, slots=True)
class Catheter:
    """Nominal values of one catheter; None where nobody measured it."""

    name: str = "unnamed"
    diameter_m: float | None = None
    flexible_length_m: float | None = None
    rigid_length_m: float | None = None
    bending_stiffness_nm2: float | None = None


CATHETER_FACTS = tuple(each.name for each in fields(Catheter) if each.name != "name")
"""Names of what may be known of a catheter."""


@dataclass(frozen=True, slots=True)
class Context:
    """What an estimator may know of a session beside its observations.

    ``metres_per_px``: scale of the picture; ``notes``: other public metadata of the recording, as text.
    """

    session: str = ""
    catheter: Catheter = Catheter()
    metres_per_px: float | None = None
    notes: Mapping[str, str] = field(default_factory=dict)

    def with_facts(self, stated: "Context") -> "Context":
        """All that it tells, but for what ``stated`` tells otherwise.

        >>> Context("a", metres_per_px=2e-4).with_facts(Context(notes={"base_side": "left"})).session
        'a'
        """
        ours, theirs = self.catheter, stated.catheter
        known = {name: getattr(theirs, name) for name in CATHETER_FACTS if getattr(theirs, name) is not None}
        named = theirs.name if theirs.name != Catheter().name else ours.name
        catheter = replace(ours, name=named, **known)
        return Context(
            stated.session or self.session,
            catheter,
            self.metres_per_px if stated.metres_per_px is None else stated.metres_per_px,
            {**self.notes, **stated.notes},
        )
