"""Facts of a rod estimator, and the same in words."""

from pydantic import BaseModel, ConfigDict, Field

from .._facts import ModelFacts, ModelSummary, count_of


class PriorFacts(BaseModel):
    """Mean and standard deviation of a constant before a session begins."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    mean: float
    std: float


class RodFacts(ModelFacts, frozen=True):
    """Facts of `rod` and `rod-track`.

    Attributes:
        priors: name of each constant of a session -> its prior.
        contact_share: share of the frames in which the tip touches.
        sessions: number of sessions that the priors were learnt from; 0: they are those of the settings.
    """

    priors: dict[str, PriorFacts] = Field(default_factory=dict)
    contact_share: float = 0.5
    sessions: int = 0

    @property
    def origin(self) -> str:
        """Where the priors are from."""
        return f"learnt from {count_of(self.sessions, 'session')}" if self.sessions else "those of the settings"

    def summary(self) -> ModelSummary:
        """Returns the origin of the priors and the basis of the intervals."""
        line = f"Priors of the rod: {self.origin}; 90 % intervals rest on {self.interval_basis}"
        inputs = "The detected centreline, the knob, and the catheter's stated stiffness and length."
        return ModelSummary(inputs, "centreline and knob", (f"{line}.",), (line,))
