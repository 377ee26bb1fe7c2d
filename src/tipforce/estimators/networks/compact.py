"""A small network made for this task: the window around the catheter, its sheet, and a doubt of its own.

Beyond the thesis: grey pictures of the window alone, heads for the force's variance, contact and the catheter's place,
intervals that follow the doubt, the mean over a picture and its mirror image, and a plain refusal of what it was not
taught: strange pictures, and those of a bench that was moved.
"""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from ...datasets import Dataset
from ...errors import InputError
from ...training import COMPACT_OUTPUTS, COMPACT_UNIT_N, UNKNOWN, CompactTask
from ...types import (
    KNOB,
    BoolArray,
    FloatArray,
    ForceEstimate,
    Image,
    Observation,
    SessionInfo,
    ShapeFeatures,
    Status,
)
from ...vision import VisionSettings, auto_calibrate
from .._answers import Interval
from .._needed import missing_facts
from .._reading import Refusal, read_actuation, read_view
from ._arrays import Arrays, Looked, Reader, spread_over
from ._doubt import Doubt, learn_doubt
from ._doubtful import Doubtful, Limits, limits_from, magnitude_sigma, relative_interval, sigma_of, wider
from ._lead import Lead, Trail, lead_from
from ._network import Answering, NetworkEstimator
from ._prepared import Form, Forms
from ._settings import CompactSettings
from ._sheet import SHEET, sheet_of
from ._window import Window, cut, widened, window_of

__all__ = ["Compact"]

_KNOB_GAIN = "actuation.knob_gain_per_m_deg"
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

    def __init__(self, settings: CompactSettings | None = None) -> None:
        super().__init__(settings)
        self._seen_side = "none"

    def settle(self, dataset: Dataset) -> None:
        """Find the border that the base lies at, where neither sheet nor settings tell; none: whole pictures."""
        silent = [
            name for name, info in dataset.session_info.items() if info.view(self.settings.view).base_side is None
        ]
        if self.settings.base_side != "auto" or not silent:
            return
        rows = spread_over(np.flatnonzero(np.isin(dataset.session, silent)), _SETTLING)
        some = dataset.subset(rows)
        views = [observation.views.get(self.settings.view) for observation in some.observations()]
        images = [view for view in views if isinstance(view, np.ndarray)]
        try:
            self._seen_side = auto_calibrate(VisionSettings(view=self.settings.view), images).base_side
        except InputError:
            self._seen_side = "none"

    def forms(self, *, training: bool) -> Forms:
        """The window, wider for training; the sheet."""
        side = self._side(training=training)
        return {"picture": ((side, side), "uint8"), "sheet": ((len(SHEET),), "float32")}

    def told(self, dataset: Dataset) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Without what every session tells, another catheter would be taken for a nominal one."""
        each = [info.stated_keys() for info in dataset.session_info.values()]
        names = [name for name in dict.fromkeys(itertools.chain(*each)) if name in self._used_metadata()]
        return tuple(name for name in names if all(name in other for other in each)), tuple(names)

    def _used_metadata(self) -> tuple[str, ...]:
        """Keys of the session metadata that it makes use of."""
        view = f"views.{self.settings.view}"
        side = (f"{view}.base_side",) if self.settings.base_side == "auto" else ()
        catheter = ("diameter_m", "flexible_length_m", "rigid_length_m", "bending_stiffness_nm2")
        return (*(f"catheter.{name}" for name in catheter), f"{view}.metres_per_px", *side, _KNOB_GAIN)

    @property
    def needed_actuation(self) -> tuple[str, ...]:
        """What it was trained with; the knob, where the sheets tell what it does. Raises NotFittedError."""
        known = self._known()
        told = _KNOB_GAIN in self.needed_facts and KNOB not in known.actuation
        return (*known.actuation, KNOB) if told else known.actuation

    def mask_form(self) -> Form:
        """A quarter as fine as the picture."""
        side = self._side(training=True) // 4
        return (side, side), "uint8"

    def _side(self, *, training: bool) -> int:
        size = self.settings.size
        return 8 * round(_WIDER * size / 8) if training else size

    def reader(self, info: SessionInfo, *, training: bool) -> Reader:
        """Cuts the window out of a session's pictures."""
        side = self._side(training=training)
        missing, seen_side = "", self._seen_side
        if not training and self.fitted_ is not None:
            missing = missing_facts(self.needed_facts, info)
            info = info.only(self.fitted_.facts["ever_told"])
            seen_side = str(self.fitted_.own["seen_side"])
        turns_knob = bool(info.actuation.knob_gain_per_m_deg)
        windows: dict[tuple[int, ...], Window] = {}

        def window(shape: tuple[int, ...]) -> Window:
            if shape not in windows:
                side_of_base = self.settings.base_side
                if side_of_base == "auto":
                    side_of_base = info.view(self.settings.view).base_side or seen_side
                base = None if side_of_base == "none" else side_of_base
                found = window_of(info, self.settings.view, shape, base, self.settings.lengths, self.settings.across)
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
            knob = read_actuation(observation, (KNOB,)) if turns_knob else None
            if isinstance(knob, Refusal):
                return knob
            made: Arrays = {
                "picture": cut(view, window(view.shape[:2]), side),
                "sheet": sheet_of(info, observation.actuation),
            }
            if training and mask is None:
                made["heat"] = np.full((side // 4, side // 4), UNKNOWN, np.uint8)
            elif mask is not None:
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

    def own_arrays(self, looked: Looked) -> Arrays:
        """Its doubt, what it refuses, and its lead; what training altered, but did not move too far, is known to it."""
        how = self.settings.augmentation
        assert isinstance(looked.task, CompactTask)
        looked = replace(looked, task=replace(looked.task, augmentation=how.model_copy(update={"moved": 0.0})))
        kept = looked.outputs(kept=True, altered=False)
        taught = looked.outputs(kept=False, altered=True)
        begun = self.begun()
        before = None if begun is None else Doubt.of(begun.own)
        doubt = learn_doubt(taught, kept, looked.outputs(kept=True, altered=True)["grid"], before)
        sigma = sigma_of(kept, doubt, COMPACT_UNIT_N)
        size = np.array([magnitude_sigma(f, s) for f, s in zip(kept["force_n"].astype(np.float64), sigma, strict=True)])
        map_taught = looked.samples.heat is not None or (begun is not None and bool(begun.own["limit_seen"] > 0))
        limits = limits_from(kept, size, self.settings.refused, map_taught=map_taught, moved_taught=how.moved > 0)
        if begun is not None and len(doubt.domains.each) > 1:  # what that one knew counts still
            limits = limits.widened(_limits_of(begun.own))
        lead = lead_from(looked, None if begun is None else _lead_of(begun.own))
        usual = np.append(np.median(sigma, axis=0), np.median(size))
        return {
            **doubt.arrays(),
            "limit_seen": np.array(limits.seen),
            "limit_sigma_n": np.array(limits.sigma_n),
            "limit_familiar": np.array(limits.familiar),
            "usual_sigma_n": usual,
            "lead_s": lead.seconds,
            "lead_alone": np.array(lead.alone),
            "seen_side": np.array(self._seen_side),
        }

    def answering(self) -> Answering:
        """Intervals that follow the doubt, and refusals."""
        fitted = self._known()
        own = fitted.own
        return Doubtful(
            fitted.known, COMPACT_UNIT_N, Doubt.of(own), _limits_of(own), fitted.interval, _lead_of(own), Trail()
        )

    @property
    def remembers(self) -> bool:
        """Once it was taught by frames that follow each other closely."""
        return self.fitted_ is not None and _lead_of(self.fitted_.own).used

    def interval(
        self, found: Sequence[ForceEstimate], truth: FloatArray, session: npt.NDArray[np.str_], drawn: str
    ) -> Interval:
        """In standard deviations of each answer.

        Samples of the same sessions promise little: where it began with another model, that one's interval, if wider.
        """
        known = self._known().known
        force = np.array([each.force_n[known] for each in found])
        sigma = np.array([np.sqrt(np.diag(each.covariance_n2)[known]) for each in found])
        found_now = relative_interval(known, force, sigma, truth, session, drawn)
        begun = self.begun()
        return found_now if begun is None or not drawn else wider(found_now, begun.interval)

    def usual_half_n(self) -> FloatArray:
        """(t + 1,): half-widths of the components' intervals and the magnitude's, at the usual doubt."""
        fitted = self._known()
        halves = np.append(fitted.interval.half_n[fitted.known], fitted.interval.magnitude_half_n)
        return halves * fitted.own["usual_sigma_n"]


def _lead_of(own: Arrays) -> Lead:
    return Lead(np.asarray(own["lead_s"], np.float64), float(own["lead_alone"]))


def _limits_of(own: Arrays) -> Limits:
    return Limits(*(float(own[f"limit_{name}"]) for name in ("seen", "sigma_n", "familiar")))
