"""A small network made for this task: the window around the catheter, its sheet, and a doubt of its own.

Beyond the thesis: grey pictures of the window alone, heads for the force's variance, contact and the catheter's place,
intervals that follow the doubt, and a plain refusal of what it was not taught.
"""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from ...dataset import Dataset
from ...errors import InputError
from ...learning import COMPACT_OUTPUTS, COMPACT_UNIT_N, CompactTask
from ...types import KNOB, BoolArray, Context, FloatArray, ForceEstimate, Image, Observation, ShapeFeatures, Status
from ...vision import VisionSettings, settle
from .._answers import Interval
from .._needed import BASE_SIDE, GAIN, missing_facts, stated_facts
from .._reading import Refusal, read_view
from ._arrays import Arrays, Looked, Reader
from ._doubt import Doubt, learn_doubt
from ._doubtful import Doubtful, Limits, limits_from, magnitude_sigma, relative_interval, seen_of, sigma_of
from ._lead import Lead, Trail, lead_from
from ._network import Answering, NetworkEstimator
from ._prepared import Form, Forms
from ._settings import CompactSettings
from ._sheet import SHEET, sheet_of
from ._window import Window, cut, widened, window_of

__all__ = ["Compact"]

_WIDER = 1.3
"""Side of the pictures that are trained on, in those of the network: there is room to shift and turn them."""
_SETTLING = 10
"""So many pictures tell where the base lies, where no sheet does."""


class Compact(NetworkEstimator):
    """See the module. ``fitted_`` is None before ``fit``."""

    name: ClassVar[str] = "compact"
    settings_type = CompactSettings
    settings: CompactSettings
    looks_at = "a window around the catheter in each picture, in grey"
    outputs = COMPACT_OUTPUTS

    def settle(self, dataset: Dataset) -> None:
        """Find the border that the base lies at, where neither sheet nor settings tell; none: whole pictures."""
        if self.settings.base_side != "auto":
            return
        told = {context.notes.get(BASE_SIDE) for context in dataset.contexts.values()}
        if None not in told:
            return
        some = dataset.subset(np.unique(np.linspace(0, len(dataset) - 1, _SETTLING).astype(np.int64)))
        views = [observation.views.get(self.settings.view) for observation in some.observations()]
        images = [view for view in views if isinstance(view, np.ndarray)]
        try:
            one = len(told - {None}) == 1
            side = (told - {None}).pop() if one else settle(VisionSettings(view=self.settings.view), images).base_side
        except InputError:
            side = "none"
        self.settings = self.settings.model_copy(update={"base_side": side})

    def forms(self, *, training: bool) -> Forms:
        """The window, wider for training; the sheet."""
        side = self._side(training=training)
        return {"picture": ((side, side), "uint8"), "sheet": ((len(SHEET),), "float32")}

    def told(self, dataset: Dataset) -> tuple[str, ...]:
        """What every session tells: an answer without it would take another catheter for a nominal one."""
        each = [stated_facts(context) for context in dataset.contexts.values()]
        settled = (BASE_SIDE,) if self.settings.base_side != "auto" else ()
        return tuple(name for name in each[0] if name not in settled and all(name in other for other in each))

    def mask_form(self) -> Form:
        """A quarter as fine as the picture."""
        side = self._side(training=True) // 4
        return (side, side), "uint8"

    def _side(self, *, training: bool) -> int:
        size = self.settings.size
        return 8 * round(_WIDER * size / 8) if training else size

    def reader(self, context: Context, *, training: bool) -> Reader:
        """Cuts the window out of a session's pictures."""
        side = self._side(training=training)
        missing = "" if training else missing_facts(self.needed_facts, context)
        gain = float(context.notes.get(GAIN, 0.0))
        windows: dict[tuple[int, ...], Window] = {}

        def window(shape: tuple[int, ...]) -> Window:
            if shape not in windows:
                side_of_base = self.settings.base_side
                if side_of_base == "auto":
                    side_of_base = context.notes.get(BASE_SIDE, "none")
                base = None if side_of_base == "none" else side_of_base
                found = window_of(context, shape, base, self.settings.lengths, self.settings.across)
                windows[shape] = widened(found, side / self.settings.size)
            return windows[shape]

        def read(observation: Observation, mask: Image | None = None) -> Arrays | Refusal:
            view = read_view(observation, self.settings.view, "view")
            if isinstance(view, Refusal):
                return view
            if isinstance(view, ShapeFeatures):
                return Refusal(Status.MISSING_INPUT, "this method looks at pictures; these data are shape numbers")
            if missing:
                return Refusal(Status.MISSING_INPUT, missing)
            if gain and KNOB not in observation.actuation:
                return Refusal(
                    Status.MISSING_INPUT, f"the sheet says what the knob does, but {KNOB} is absent; state it"
                )
            made: Arrays = {
                "picture": cut(view, window(view.shape[:2]), side),
                "sheet": sheet_of(context, observation.actuation),
            }
            if mask is not None:
                made["heat"] = cut(np.where(mask, np.uint8(255), np.uint8(0)), window(view.shape[:2]), side // 4)
            return made

        return read

    def task(self, known: BoolArray, in_base: bool, actuation: tuple[tuple[float, float], ...]) -> CompactTask:
        """See `CompactTask`."""
        return CompactTask(
            outputs=int(known.sum()),
            sheet=len(SHEET),
            size=self.settings.size,
            planar=(0, 1) if in_base and bool(known[:2].all()) else None,
            augmentation=self.settings.augmentation,
            actuation=actuation,
        )

    def own_arrays(self, looked: Looked, *, masks: bool) -> Arrays:
        """Its doubt, what it refuses, and its lead: what training altered at random is not strange to it."""
        kept = looked.outputs(kept=True, altered=False)
        taught = looked.outputs(kept=False, altered=True)
        doubt = learn_doubt(taught, looked.outputs(kept=True, altered=True)["grid"])
        sigma = sigma_of(kept, doubt, COMPACT_UNIT_N)
        size = np.array([magnitude_sigma(f, s) for f, s in zip(kept["force_n"].astype(np.float64), sigma, strict=True)])
        limits = limits_from(seen_of(kept), size, self.settings.refused, masks)
        begun = self._begin.fitted_ if isinstance(self._begin, Compact) else None
        lead = lead_from(looked, None if begun is None else _lead_of(begun.own))
        usual = np.append(np.median(sigma, axis=0), np.median(size))
        return {
            **doubt.arrays(),
            "limit_seen": np.array(limits.seen),
            "limit_sigma_n": np.array(limits.sigma_n),
            "usual_sigma_n": usual,
            "lead_s": lead.seconds,
            "lead_alone": np.array(lead.alone),
        }

    def answering(self) -> Answering:
        """Intervals that follow the doubt, and refusals."""
        fitted = self._known()
        own = fitted.own
        limits = Limits(float(own["limit_seen"]), float(own["limit_sigma_n"]))
        return Doubtful(fitted.known, COMPACT_UNIT_N, Doubt.of(own), limits, fitted.interval, _lead_of(own), Trail())

    @property
    def remembers(self) -> bool:
        """Once it was taught by frames that follow each other closely."""
        return self.fitted_ is not None and _lead_of(self.fitted_.own).used

    def interval(
        self, found: Sequence[ForceEstimate], truth: FloatArray, session: npt.NDArray[np.str_], drawn: str
    ) -> Interval:
        """In standard deviations of each answer."""
        known = self._known().known
        force = np.array([each.force_n[known] for each in found])
        sigma = np.array([np.sqrt(np.diag(each.covariance_n2)[known]) for each in found])
        return relative_interval(known, force, sigma, truth, session, drawn)

    def usual_half_n(self) -> FloatArray:
        """(t + 1,): half-widths of the components' intervals and the magnitude's, at the usual doubt."""
        fitted = self._known()
        halves = np.append(fitted.interval.half_n[fitted.known], fitted.interval.magnitude_half_n)
        return halves * fitted.own["usual_sigma_n"]


def _lead_of(own: Arrays) -> Lead:
    return Lead(np.asarray(own["lead_s"], np.float64), float(own["lead_alone"]))
