"""Thresholds: where contact begins, the force window, the limit."""

from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

CONTACT_N = 0.01
"""Above this magnitude the tip counts as in contact."""
WINDOW_N = (0.1, 0.3)
"""Contact forces that ablation wants, of the thesis: a lesion needs 0.1 N, and 0.3 N is its safe limit."""
LIMIT_N = 0.4
"""Above this force (41 g) the alarm sounds and the loop draws back. It is this program's limit, not the thesis's: an
estimate's interval has to fit between the window and the limit."""

_Newtons = Annotated[float, Field(gt=0, le=10)]


class ContactSettings(BaseModel):
    """What counts as contact, as the window and as too much. Window and limit are two things, and may differ."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    contact_n: _Newtons = CONTACT_N
    """Above this magnitude the tip is in contact."""
    window_n: tuple[_Newtons, _Newtons] = WINDOW_N
    """The force window, both ends in it; the default is the thesis's."""
    limit_n: _Newtons = LIMIT_N
    """Above it the force is excessive; the default is this program's, the thesis's safe limit is the window's end."""
    class_s: Annotated[float, Field(ge=0.1, le=600)] = 3.0
    """The contact class is that of so many last seconds: some heart beats."""
    swing_n: _Newtons = 0.2
    """Contact whose force changes by more within ``class_s`` is variable."""
    max_unknown_share: Annotated[float, Field(ge=0, le=1)] = 0.2
    """With more of ``class_s`` unknown there is no class."""
    max_gap_s: Annotated[float, Field(gt=0, le=60)] = 0.25
    """A longer time between two frames is unknown; what passes between nearer ones is taken from both."""

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
