"""Method `fusion`: `rod-track` and a `compact` network joined by their covariances, frame by frame.

The rod reads the shape alone and needs no tissue; the network reads the tissue's indentation, too, and knows the tissue
as classes only. Their limits differ (the rod: a push along its axis, and wrong metadata of catheter and camera;
the network: the tissue, and images unlike its training). So they are joined as independent Gaussians: their
information is added, where that of the rod is limited by `FusionSettings.rod_std_n`. The network is also used where its
own estimate is too uncertain to be valid alone. Where the two differ by more than their covariances, now or recently,
one of them is wrong, and it is not known which: the joint covariance grows by their squared Birge ratio. There is no
estimate where they differ too much or the interval is too wide. Where one abstains, the other one is used with its own
intervals. The network is not used in images without a detected catheter, nor where the rod explained too few of the
recent frames: its estimates are then unreliable. Where separate sessions have shown that large forces are read too
small, estimates of the network and joint ones are stretched (`Fusion.calibrate`).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field

from ..datasets import Dataset
from ..errors import InputError, ModelError
from ..types import FloatArray, ForceEstimate, Image, Observation, SessionInfo, Status
from ..vision import VisionSettings
from ._base import Estimator, Progress, Stream, no_progress
from ._builder import MAX_FORCE_N, implausible, within_error
from ._facts import ModelFacts, ModelSummary
from ._stretch import NO_STRETCH, Stretch, fit_stretch
from ._values import stored_array
from .networks import Compact, CompactStream, NetworkFacts
from .session import RodFacts, RodTrack, RodTrackSettings
from .store import load_model
from .uncertainty import Interval, gaussian_interval, magnitude_sigma, normalised_interval

_Std = Annotated[float, Field(ge=0, le=10)]
_KNOWN = np.array([True, True, False])
_ALONE = gaussian_interval(_KNOWN, "the covariances alone")
_DOUBTED = 0.5
"""Share of ``max_error_n`` for an interval that rests on covariances alone, which are too small on other data, and
for a network alone where the tip cannot be distinguished from the background (docs/results/trust.md)."""
MIN_AGREEMENT_SHARE = 0.3
"""Smallest share of the recent frames in which the rod agreed with the network."""
MIN_FRAMES = 200
"""With fewer frames of one source its intervals are those of all sources together."""


class FusionSource(StrEnum):
    """Which of the members an estimate is from."""

    BOTH = "both"
    ROD = "rod"
    NETWORK = "network"

    @property
    def text(self) -> str:
        """Text of an estimate from this source; empty for both."""
        return {"both": "", "rod": "rod-track alone", "network": "network alone"}[self.value]


class StretchFacts(BaseModel):
    """By how much the magnitude grows above ``from_n`` newtons; see `Stretch`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    gain: float = 0.0
    from_n: float = 0.0


class FusionFacts(ModelFacts, frozen=True):
    """Facts of both members, and the stretch."""

    rod: RodFacts = RodFacts()
    network: NetworkFacts
    stretch: StretchFacts = StretchFacts()

    def summary(self) -> ModelSummary:
        """Returns the origin of the members, and the basis of the intervals."""
        line = f"Priors of the rod: {self.rod.origin}; network: compact; 90 % intervals rest on {self.interval_basis}"
        if self.stretch.gain > 0.0:
            line += f"; the part above {self.stretch.from_n:.2g} N counts {1.0 + self.stretch.gain:.2f} times"
        return ModelSummary(
            "The detected centreline and a window around the catheter, the knob, the stated stiffness and length.",
            "image, centreline and knob",
            (f"{line}.",),
            (line,),
        )


class FusionSettings(BaseModel):
    """Settings of `fusion`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    network: Annotated[str, Field(min_length=1, max_length=4096)] = "pretrained/compact-wide"
    """Folder of the `compact` model; its own copy is kept in the saved model."""
    rod: RodTrackSettings = RodTrackSettings(vision=VisionSettings(method="auto"))
    """Settings of `rod-track`. Where the tracer finds no catheter the networks of detection search it: the rod and the
    network for the force reject a line of another object."""
    max_distance: Annotated[float, Field(gt=0, le=1e6)] = 50.0
    """Largest squared Mahalanobis distance of the two forces. A Gaussian's exceeds 13.8 once in 1,000; the rod, pushed
    along its axis by a clamp that moves, is no Gaussian and reads 1.3 N for 0.2 N (docs/results/trust.md)."""
    rod_std_n: tuple[_Std, _Std] = (0.005, 0.05)
    """Added to the standard deviations of the rod's force, along the direction that the shape determines best and
    the one that it determines least, which is the shaft's axis: its covariance lacks lasting errors, and a straight
    shaft appears to be free of contact (docs/results/trust.md)."""
    disagreement_s: Annotated[float, Field(gt=0, le=1e4)] | None = 1.0
    """Where rod and network differ by more than they promise (the rod's own covariance, ``rod_std_n`` added across the
    shaft alone), the joint covariance is multiplied by the squared Birge ratio: the squared Mahalanobis distance,
    either the present one or its mean over this time, the larger of both. null: it is not multiplied, which is right
    for a network that knows the tissue well: a rod that is pushed along its axis is then little evidence against it
    (docs/results/trust.md)."""
    vouched_s: Annotated[float, Field(gt=0, le=1e4)] | None = 30.0
    """The network answers alone only where the rod explained the shape, and agreed with it, in 30 % of the
    frames in which the network had an answer, remembered for this time: images of another world, in which it reads
    some force or other, show a shape that is none of the stated rod (docs/results/trust.md). null: it always may, which
    is right for a network that was trained on this bench, above all in a closed loop."""
    max_error_n: Annotated[float, Field(gt=0, le=100)] | None = 0.15
    """Abstains where the 90 % interval of the magnitude reaches further than this from the estimate (the rod alone
    where it reaches half as far, until `Fusion.calibrate` has checked its interval; the network alone, too, where the
    tip cannot be distinguished from the background); null: no limit, the interval shows the uncertainty."""


@dataclass(frozen=True, eq=False)
class _Members:
    rod: RodTrack
    network: Compact


class Fusion(Estimator):
    """See the module. ``intervals_``: by source, in standard deviations of the joint covariance.

    ``stretch_``: stretch of estimates in which the network is used; `calibrate` finds it and the intervals.
    """

    name: ClassVar[str] = "fusion"
    view_setting = "rod.vision.view"
    settings_type = FusionSettings
    settings: FusionSettings
    needs_fit: ClassVar[bool] = False
    breaks: ClassVar[str] = "Where the line is detected wrongly and the tissue is unlike any that the network has seen."

    def __init__(self, settings: FusionSettings | None = None) -> None:
        super().__init__(settings)
        self._members: _Members | None = None
        self.intervals_: dict[FusionSource, Interval] = dict.fromkeys(FusionSource, _ALONE)
        self.stretch_ = NO_STRETCH

    @property
    def members(self) -> _Members:
        """Rod and network; the network is read when it is first needed. Raises ModelError where it is no `compact`."""
        if self._members is None:
            network = load_model(Path(self.settings.network))
            if not isinstance(network, Compact):
                raise ModelError(
                    f"network={self.settings.network}: is a model of {network.name}; fusion needs one of compact"
                )
            if network.fitted_ is None or not network.fitted_.known[:2].all():
                raise ModelError(
                    f"network={self.settings.network}: does not estimate both fx and fy; fusion needs them"
                )
            rod = RodTrack(self.settings.rod)
            if rod.view_is_stated and not network.view_is_stated:
                network = network.reading(rod.views[0])
            elif network.view_is_stated and not rod.view_is_stated:
                rod = rod.reading(network.views[0])
            self._members = _Members(rod, network)
        return self._members

    def fit(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Learns the rod's priors; the network stays as it is: train it by itself and name it as ``network``.

        Raises InputError as `RodTrack.fit` does.
        """
        self.members.rod.fit(dataset, progress)
        return self

    def calibrate(self, dataset: Dataset, progress: Progress | None = None) -> Self:
        """Finds the intervals of each source on sessions apart, and how far large forces were drawn to the usual ones.

        Raises InputError where fx or fy are unknown, or no sample has an estimate.
        """
        report = progress or no_progress
        if not dataset.known[:2].all():
            raise InputError(f"{dataset.title}: fusion needs fx and fy of the base frame to calibrate its intervals")
        every = type(self)(self.settings.model_copy(update={"max_error_n": None}))
        every._members = self.members
        found = every.predict(dataset, lambda share: report("calibrating", share))
        index = np.array([row for row, each in enumerate(found) if each.valid], np.int64)
        if not len(index):
            raise InputError(f"{dataset.title}: no sample has an estimate, so there are no intervals to calibrate")
        force = np.array([found[row].force_n[:2] for row in index])
        covariance = np.array([found[row].covariance_n2[:2, :2] for row in index])
        sources = np.array([found[row].source for row in index])
        truth, session = dataset.force_n[index][:, :2], dataset.session[index]
        size, stretched = np.linalg.norm(force, axis=1), sources != FusionSource.ROD
        self.stretch_ = fit_stretch(size[stretched], np.linalg.norm(truth[stretched], axis=1), session[stretched])
        ratio = np.where(stretched, self.stretch_.ratio(size), 1.0)
        force *= ratio[:, None]
        covariance *= ratio[:, None, None] ** 2

        def interval(kept: npt.NDArray[np.bool_]) -> Interval:
            return normalised_interval(_KNOWN, force[kept], covariance[kept], truth[kept], session[kept], "")

        whole = interval(np.ones(len(index), np.bool_))
        for source in FusionSource:
            kept = sources == source
            self.intervals_[source] = interval(kept) if kept.sum() >= MIN_FRAMES else whole
        return self

    @property
    def view_is_stated(self) -> bool:
        """True where the settings of the rod, or the network's training, chose a view."""
        return super().view_is_stated or self.members.network.view_is_stated

    def reading(self, view: str) -> Self:
        """Returns rod and network for another view; see `Estimator.reading`."""
        made, members = super().reading(view), self.members
        made._members = _Members(members.rod.reading(view), members.network.reading(view))
        return made

    @property
    def views(self) -> tuple[str, ...]:
        """Those of both."""
        return tuple(dict.fromkeys((*self.members.rod.views, *self.members.network.views)))

    @property
    def calibrates_on_images(self) -> bool:
        """As the rod's detection."""
        return self.members.rod.calibrates_on_images

    @property
    def uses_history(self) -> bool:
        """It remembers."""
        return True

    @property
    def training_sessions(self) -> frozenset[str]:
        """The network's, as of a model that it began with."""
        return self.members.network.training_sessions

    def start(self, info: SessionInfo, images: Sequence[Image] = ()) -> Stream:
        """Returns a stream for one session; see `Estimator.start`. A member without a required input abstains."""
        members = self.members
        return FusionStream(
            members.rod.start(info, images),
            members.network.start(info, images),
            self.settings,
            {source: self._interval(source) for source in FusionSource},
            self.stretch_,
        )

    def _interval(self, source: FusionSource) -> Interval:
        """Returns the interval of ``source``; before `calibrate` that of the network, but for the rod alone."""
        own, fitted = self.intervals_[source], self.members.network.fitted_
        return (
            fitted.interval
            if own.basis == _ALONE.basis and source is not FusionSource.ROD and fitted is not None
            else own
        )

    def unfitted(self) -> Self:
        """Returns the same settings and network without the learnt state."""
        made = type(self)(self.settings)
        if self._members is not None:
            made._members = _Members(self._members.rod.unfitted(), self._members.network)
        return made

    def state(self) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
        """Returns the state of both members, the intervals and the stretch."""
        rod, rod_arrays = self.members.rod.state()
        network, network_arrays = self.members.network.state()
        values = {
            "rod": rod,
            "network": network,
            "view": self.members.rod.views[0],
            "network_settings": self.members.network.settings.model_dump(mode="json"),
            "intervals": {source: each.values() for source, each in self.intervals_.items()},
            "stretch": [self.stretch_.gain, self.stretch_.from_n],
        }
        arrays = {f"rod.{name}": each for name, each in rod_arrays.items()}
        return values, arrays | {f"network.{name}": each for name, each in network_arrays.items()}

    def files(self) -> dict[str, bytes]:
        """The network's."""
        return self.members.network.files()

    @classmethod
    def from_state(
        cls,
        settings: Mapping[str, Any],
        values: Mapping[str, Any],
        arrays: Mapping[str, npt.NDArray[Any]],
        files: Mapping[str, bytes] | None = None,
    ) -> Self:
        """The inverse of `state` and `files`."""
        made = cls(cls.settings_type.model_validate(settings))  # type: ignore[arg-type]

        def of(member: str) -> dict[str, npt.NDArray[Any]]:
            return {name.removeprefix(member): each for name, each in arrays.items() if name.startswith(member)}

        rod = made.settings.rod.model_dump(mode="json")
        rod["vision"]["view"] = values.get("view", rod["vision"]["view"])
        made._members = _Members(
            RodTrack.from_state(rod, values["rod"], of("rod.")),
            Compact.from_state(values["network_settings"], values["network"], of("network."), files),
        )
        made.intervals_ = {source: Interval.of(values["intervals"][source], _KNOWN) for source in FusionSource}
        gain, from_n = stored_array({"stretch": np.array(values.get("stretch", (0.0, 0.0)))}, "stretch", (2,), low=0.0)
        made.stretch_ = Stretch(float(gain), float(from_n))
        return made

    def describe(self) -> FusionFacts:
        """Returns the facts of both members, the basis of the intervals, and the stretch."""
        each = {source: self._interval(source).basis for source in FusionSource}
        same = len(set(each.values())) == 1
        both = each[FusionSource.BOTH]
        basis = both if same else "; ".join(f"{source.text or 'both'}: {text}" for source, text in each.items())
        return FusionFacts(
            rod=self.members.rod.describe(),
            network=self.members.network.describe(),
            interval_basis=basis,
            stretch=StretchFacts(gain=self.stretch_.gain, from_n=self.stretch_.from_n),
        )


class FusionStream:
    """One session, frame after frame."""

    def __init__(
        self,
        rod: Stream,
        network: CompactStream,
        settings: FusionSettings,
        intervals: Mapping[FusionSource, Interval],
        stretch: Stretch = NO_STRETCH,
    ) -> None:
        self._rod, self._network, self._settings, self._intervals = rod, network, settings, intervals
        self._stretch = stretch
        self._disagreement = _BirgeRatio(settings.disagreement_s)
        self._vouched = _RodAgreement(settings.vouched_s)

    def update(self, observation: Observation) -> ForceEstimate:
        """Returns the force at this observation; the status states the reason of an abstention."""
        own = self._rod.update(observation)
        by_rod = _believed(own, self._settings.rod_std_n)
        # a push along the shaft's axis is no reason to reject the image: the shape does not show it
        fits = by_rod.valid or by_rod.status is Status.UNOBSERVABLE
        by_network = replace(self._network.update(observation, unsure=fits), shape=by_rod.shape)
        if by_rod.status is Status.NO_CATHETER and by_network.valid:
            return by_rod  # the network saw the image all the same: it remembers
        if not by_rod.valid and not by_network.valid:
            detail = f"rod-track: {by_rod.detail}; network: {by_network.detail}"
            return replace(by_network, status=by_rod.status, detail=detail)
        if not by_network.valid:
            unchecked = self._intervals[FusionSource.ROD].basis == _ALONE.basis
            return self._estimate(
                by_rod.force_n[:2], by_rod.covariance_n2[:2, :2], by_rod, FusionSource.ROD, doubted=unchecked
            )
        contradict = by_rod.valid and not _squared_distance(by_rod, by_network) <= self._settings.max_distance
        self._vouched.add(by_network.stamp_ns, fits and not contradict)
        if not by_rod.valid:
            if not self._vouched:
                detail = f"rod-track: {by_rod.detail}; it agreed with the network in too few of the recent frames"
                return replace(by_rod, detail=detail)
            wider = self._disagreement.remembered() * by_network.covariance_n2[:2, :2]
            cut_off = by_rod.status is Status.CUT_OFF
            return self._estimate(by_network.force_n[:2], wider, by_network, FusionSource.NETWORK, doubted=cut_off)
        if contradict:
            return ForceEstimate.invalid(
                by_rod.stamp_ns,
                Status.OUT_OF_DISTRIBUTION,
                f"rod-track and network differ too much: {by_rod.magnitude_n:.2f} N from the shape, "
                f"{by_network.magnitude_n:.2f} N from the image",
                by_rod.shape,
                _hull(by_rod, by_network),
            )
        across = _believed(own, (self._settings.rod_std_n[0], 0.0))
        return self._joined(by_rod, by_network, _squared_distance(across, by_network))

    def _joined(self, by_rod: ForceEstimate, by_network: ForceEstimate, promised: float) -> ForceEstimate:
        """``promised``: their squared distance in their own covariances."""
        forces = by_rod.force_n[:2], by_network.force_n[:2]
        covariances = by_rod.covariance_n2[:2, :2], by_network.covariance_n2[:2, :2]
        information = [np.linalg.inv(each) for each in covariances]
        covariance = np.asarray(np.linalg.inv(information[0] + information[1]), np.float64)
        force = covariance @ (information[0] @ forces[0] + information[1] @ forces[1])
        covariance *= self._disagreement.update(by_network.stamp_ns, promised)
        return self._estimate(force, covariance, by_network, FusionSource.BOTH)

    def _estimate(
        self,
        force: FloatArray,
        covariance: FloatArray,
        found: ForceEstimate,
        source: FusionSource,
        *,
        doubted: bool = False,
    ) -> ForceEstimate:
        """Force (2,) and covariance (2, 2) with the intervals of their source; the rest is ``found``'s."""
        size = math.hypot(*force.tolist())
        if source is not FusionSource.ROD:
            ratio = float(self._stretch.ratio(np.array(size)))
            force, covariance, size = ratio * force, ratio**2 * covariance, ratio * size
        if not size <= MAX_FORCE_N:
            return implausible(found.stamp_ns, size, found.shape)
        interval, whole, full = np.full((3, 2), np.nan), np.full((3, 3), np.nan), np.full(3, np.nan)
        full[:2], whole[:2, :2] = force, covariance
        widths = self._intervals[source]
        half = widths.half_n[:2] * np.sqrt(np.diag(covariance))
        interval[:2, 0], interval[:2, 1] = force - half, force + half
        estimate = ForceEstimate(
            stamp_ns=found.stamp_ns,
            force_n=full,
            known=_KNOWN,
            covariance_n2=whole,
            interval_n=interval,
            magnitude_n=size,
            magnitude_interval_n=np.array(widths.magnitude_interval(size, magnitude_sigma(force, covariance))),
            detail=source.text,
            contact=found.contact,
            shape=found.shape,
            source=source,
        )
        limit_n = self._settings.max_error_n
        return within_error(estimate, limit_n * _DOUBTED if limit_n is not None and doubted else limit_n)


class _BirgeRatio:
    """Ratio of the difference of two sources to their covariances: the squared Birge ratio, at least 1.

    Birge, "The calculation of errors by the method of least squares", Physical Review 40 (1932), 207-227, for two
    sources; ``memory_s``: time constant of its mean, None: it is 1 always.
    """

    def __init__(self, memory_s: float | None) -> None:
        self._memory_s = memory_s
        self._mean = 1.0
        self._stamp_ns: int | None = None

    def update(self, stamp_ns: int, squared_distance: float) -> float:
        """The ratio with one more ``squared_distance`` of Mahalanobis."""
        if self._memory_s is None:
            return 1.0
        elapsed_s = 0.0 if self._stamp_ns is None else max(0.0, (stamp_ns - self._stamp_ns) * 1e-9)
        kept = math.exp(-elapsed_s / self._memory_s)
        self._mean = kept * self._mean + (1.0 - kept) * squared_distance
        self._stamp_ns = stamp_ns
        return max(1.0, self._mean, squared_distance)

    def remembered(self) -> float:
        """The ratio where one of them is silent."""
        return max(1.0, self._mean)


class _RodAgreement:
    """True where the rod agreed with the network often enough; a time constant of None: always."""

    def __init__(self, memory_s: float | None) -> None:
        self._memory_s = memory_s
        self._together = self._alone = 0.0
        self._stamp_ns: int | None = None

    def add(self, stamp_ns: int, together: bool) -> None:
        """Adds a frame in which the network has an estimate, and whether the rod agrees with it."""
        elapsed_s = 0.0 if self._stamp_ns is None else max(0.0, (stamp_ns - self._stamp_ns) * 1e-9)
        self._stamp_ns = stamp_ns
        kept = 1.0 if self._memory_s is None else math.exp(-elapsed_s / self._memory_s)
        self._together = kept * self._together + together
        self._alone = kept * self._alone + (not together)

    def __bool__(self) -> bool:
        return self._memory_s is None or self._together >= MIN_AGREEMENT_SHARE * (self._together + self._alone)


def _hull(one: ForceEstimate, other: ForceEstimate) -> tuple[float, float]:
    """Returns the interval of the magnitude that spans those of both."""
    lows, highs = np.stack([one.magnitude_interval_n, other.magnitude_interval_n], axis=1)
    return float(lows.min()), float(highs.max())


def _squared_distance(one: ForceEstimate, other: ForceEstimate) -> float:
    """Returns the squared Mahalanobis distance between two forces in the plane."""
    apart = one.force_n[:2] - other.force_n[:2]
    return float(apart @ np.linalg.solve(one.covariance_n2[:2, :2] + other.covariance_n2[:2, :2], apart))


def _believed(by_rod: ForceEstimate, std_n: tuple[float, float]) -> ForceEstimate:
    """The rod's estimate with ``std_n`` added along the axes of its covariance, the surer one first."""
    if not by_rod.valid:
        return by_rod
    variances, axes = np.linalg.eigh(by_rod.covariance_n2[:2, :2])
    whole = by_rod.covariance_n2.copy()
    whole[:2, :2] = (axes * (variances + np.square(std_n))) @ axes.T
    return replace(by_rod, covariance_n2=whole)
