"""Thresholds of contact, force window and limit."""

from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

CONTACT_N = 0.01
"""Above this magnitude the tip is in contact."""
WINDOW_N = (0.1, 0.3)
"""Window of contact forces for ablation, of the thesis: a lesion needs 0.1 N, and 0.3 N is its safe limit."""
LIMIT_N = 0.4
"""Above this force (41 g) the alarm sounds and the control loop retracts the catheter. It is the limit of this program,
not of the thesis: the interval of an estimate must fit between the window and the limit."""

_Newtons = Annotated[float, Field(gt=0, le=10)]


class ContactSettings(BaseModel):
    """Thresholds of contact, window and limit. The end of the window and the limit are independent and may differ."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    contact_n: _Newtons = CONTACT_N
    """Above this magnitude the tip is in contact."""
    window_n: tuple[_Newtons, _Newtons] = WINDOW_N
    """The force window, with both ends; the default is that of the thesis."""
    limit_n: _Newtons = LIMIT_N
    """Above it the force is excessive; the default is of this program; the safe limit of the thesis ends the window."""
    class_s: Annotated[float, Field(ge=0.1, le=600)] = 3.0
    """Duration of the last seconds that determine the contact class: some heart beats."""
    swing_n: _Newtons = 0.2
    """Contact is variable if its force changes by more within ``class_s``."""
    max_unknown_share: Annotated[float, Field(ge=0, le=1)] = 0.2
    """Largest unknown share of ``class_s`` with which there is a class."""
    max_gap_s: Annotated[float, Field(gt=0, le=60)] = 0.25
    """A longer time between two frames is unknown; in a shorter one each frame holds for one half."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        low, high = self.window_n
        if not self.contact_n <= low < high:
            raise ValueError(
                f"expected contact_n <= window_n[0] < window_n[1], got {self.contact_n:g}, {low:g}, {high:g}"
            )
        if self.limit_n < low:
            raise ValueError(f"expected limit_n of at least window_n[0] = {low:g}, got {self.limit_n:g}")
        return self
