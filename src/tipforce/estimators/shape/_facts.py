"""Facts of a fitted shape regressor, and the same in words."""

from collections.abc import Mapping

from pydantic import BaseModel, ConfigDict, Field

from ...vision import detector_kind
from .._facts import ModelFacts, ModelSummary, count_of, half_width_text, magnitude_intervals
from .._left_out import left_out_text


class TargetFacts(BaseModel):
    """Facts of one estimated number.

    Attributes:
        cv_rmse_n: root mean square error over the folds, in newtons.
        interval_half_width_n: half the width of its 90 % interval; None where it is unbounded.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    cv_rmse_n: float
    interval_half_width_n: float | None


class ShapeFacts(ModelFacts, frozen=True):
    """Facts of every shape regressor.

    Attributes:
        targets: name of each estimated number -> its facts.
        magnitude_interval_half_width_n: half-width of the magnitude's interval; None where it is unbounded.
        magnitude_interval_n: the magnitude's interval in newtons, by the estimate.
        features: names of the numbers that it reads of a frame.
        detection: method of the centreline detection; None for ready-made shape numbers.
        sessions: number of sessions that it learnt from.
    """

    targets: Mapping[str, TargetFacts] = Field(default_factory=dict)
    magnitude_interval_half_width_n: float | None = None
    magnitude_interval_n: dict[str, list[float]] = Field(default_factory=dict)
    features: tuple[str, ...] = ()
    detection: str | None = None
    sessions: int = 0

    @property
    def columns(self) -> dict[str, dict[str, str]]:
        """Further columns of the table of targets: heading -> target -> text."""
        return {}

    def summary(self) -> ModelSummary:
        """Returns inputs, errors over the folds and intervals in words, for the model card and after a training."""
        numbers = f"{count_of(len(self.features), 'number')} a frame"
        inputs = f"{numbers}: {', '.join(self.features)}."
        training: list[str] = []
        if self.detection is not None:
            thesis = (
                "the thesis's algorithm 1" if detector_kind(self.detection).thesis else "not the thesis's algorithm 1"
            )
            inputs += f" The centreline is found by `{self.detection}`, {thesis}."
        if self.left_out:
            training.append(f"samples in which no shape was found: {left_out_text(self.left_out)}")
            inputs += f" Samples in which no shape was found: {left_out_text(self.left_out)}."
        more = self.columns
        headings = ["estimate", *more, "error over folds (RMSE)", "90 % interval"]
        performance = [f"| {' | '.join(headings)} |", "|---" * len(headings) + "|"]
        for name, each in self.targets.items():
            rmse, half = f"{each.cv_rmse_n * 1e3:.1f} mN", half_width_text(each.interval_half_width_n)
            cells = [name, *(texts[name] for texts in more.values()), rmse, half]
            performance.append(f"| {' | '.join(cells)} |")
            training.append(f"{name}: {self.target_text(name)}error over folds {rmse}; 90 % interval {half}")
        intervals = magnitude_intervals(self.magnitude_interval_n)
        performance += [
            *(f"\n{line[0].upper()}{line[1:]}." for line in intervals),
            "",
            "The errors are those on samples held out in turn, within the training data.",
        ]
        return ModelSummary(inputs, numbers, tuple(performance), (*training, *intervals))

    def target_text(self, name: str) -> str:
        """Returns the method's own facts of a target in words, ending in "; "; empty where there are none."""
        del name
        return ""
