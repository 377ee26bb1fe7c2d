"""`compact`: a small network for a window around the catheter, with metadata of the session and its own uncertainty.

Beyond the thesis: grey images of the window alone; outputs for the variance of the force, contact and the catheter's
heatmap; the force for each class of tissue, weighed by the evidence of the session on its tissue; intervals that follow
the predicted uncertainty; the mean over an image and its mirror image; abstention from images unlike the training
images, and from those of a displaced camera or bench.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from ...datasets import Dataset
from ...errors import InputError
from ...training import COMPACT_OUTPUTS, COMPACT_UNIT_N, HEATMAP_UNKNOWN, TISSUE_OUTPUTS, CompactTask
from ...types import KNOB, BoolArray, FloatArray, ForceEstimate, Image, Observation, SessionInfo, Status
from ...vision import VisionSettings, auto_calibrate
from .._reading import Abstention, read_actuation, read_advance_m, read_image
from .._recent_share import RecentShare
from .._session_metadata import missing_metadata
from .._values import stored_array, stored_number
from ..uncertainty import (
    Interval,
    LastLayerLaplace,
    OodDetector,
    fit_laplace,
    fit_ood_detector,
    magnitude_sigma,
    normalised_interval,
    wider_interval,
)
from ._calibration import CalibrationBatch, Outputs, spread_evenly
from ._compact_estimates import (
    AbstentionLimits,
    CompactEstimateBuilder,
    component_sigma,
    fit_abstention_limits,
    heatmap_pixels,
    largest_trusted_sigma,
)
from ._image_input import BASE_SIDES, Window, catheter_window, crop_window, enlarged, moved
from ._network import NetworkEstimator, NetworkStream
from ._preparation import Arrays, InputReader, Masks, Spec, Specs
from ._rate_compensation import MAX_COMPENSATION_S, History, RateCompensation, rate_compensation_from
from ._settings import CompactSettings, CropSettings
from ._tissue import TissueBelief, TissueEvidence, fit_tissue_evidence

METADATA_FEATURES = ("log_stiffness", "log_length", "diameter", "bend")
"""Logarithms of stiffness and length over the values below; diameter over that below, less one; the curvature that the
knob sets, times the length."""

STIFFNESS_NM2, LENGTH_M, DIAMETER_M = 4.3e-4, 0.04, 2.33e-3
"""A 7F ablation catheter 40 mm in front of its sheath."""

_KNOB_GAIN = "actuation.knob_gain_per_m_deg"
_TRAINING_SIZE = 1.3
"""Side of the training images over that of the network's: there is room for augmentation."""
MIN_STIFFNESS_RATIO = 2.0
"""Classes of tissue are learnt if the stiffest tissue of the training data is at least this ratio above the softest."""
_IN_DISTRIBUTION_S, MIN_IN_DISTRIBUTION_SHARE = 2.0, 0.5
"""Time constant and smallest value of the share of recent images that must be in distribution."""
_CALIBRATION_IMAGES = 10
"""Images in which the base's border is detected, where the metadata do not state it."""


def metadata_features(info: SessionInfo, actuation: Mapping[str, float]) -> npt.NDArray[np.float32]:
    """Returns `METADATA_FEATURES` (4,) of catheter and bench; 0 for unknown values.

    Args:
        info: metadata of the session.
        actuation: readings of the drives by name.

    >>> metadata_features(SessionInfo(), {}).tolist()
    [0.0, 0.0, 0.0, 0.0]
    """
    catheter = info.catheter
    stiffness, length, diameter = catheter.bending_stiffness_nm2, catheter.flexible_length_m, catheter.diameter_m
    gain = info.actuation.knob_gain_per_m_deg
    bend = 0.0
    if gain is not None and length is not None:
        bend = gain * actuation.get(KNOB, 0.0) * length
    features = (
        math.log(stiffness / STIFFNESS_NM2) if stiffness else 0.0,
        math.log(length / LENGTH_M) if length else 0.0,
        diameter / DIAMETER_M - 1.0 if diameter else 0.0,
        bend,
    )
    return np.array(features, np.float32)


class _ViewWindow:
    """The window of one view in the images of a session, which follows the clamp.

    Args:
        info: metadata of the session.
        view: name of the view.
        detected_base_side: border of the base, where neither the settings nor the metadata state it.
        settings: settings of the window.
        side: side of its image in pixels, which may be larger than that of the network's image.
    """

    def __init__(
        self, info: SessionInfo, view: str, detected_base_side: str, settings: CropSettings, side: int
    ) -> None:
        base_side = settings.base_side
        if base_side == "auto":
            base_side = info.view(view).base_side or detected_base_side
        self._base_side = None if base_side == "none" else base_side
        self._info, self._view, self._settings, self._side = info, view, settings, side
        self._scale = info.view(view).metres_per_px
        self._windows: dict[tuple[int, ...], Window] = {}

    def at(self, shape: tuple[int, ...], advance_m: float) -> Window:
        """Returns the window in an image.

        Args:
            shape: (h, w) of the image.
            advance_m: distance by which the clamp has been advanced, m.
        """
        if shape not in self._windows:
            lengths, across = self._settings.lengths, self._settings.across
            network_window = catheter_window(self._info, self._view, shape, self._base_side, lengths, across)
            self._windows[shape] = enlarged(network_window, self._side / self._settings.size)
        window = self._windows[shape]
        return moved(window, advance_m / self._scale) if self._scale is not None and window.at_base else window


class Compact(NetworkEstimator):
    """See the module. ``fitted_`` is None before ``fit``."""

    name: ClassVar[str] = "compact"
    settings_type = CompactSettings
    settings: CompactSettings
    input_text = "a window around the catheter in each image, in grey"
    metadata_features: ClassVar[tuple[str, ...]] = METADATA_FEATURES
    """Names of the metadata features."""
    view_metadata: ClassVar[tuple[str, ...]] = ()
    """Metadata of a view that the features use, beside those of its window."""

    def __init__(self, settings: CompactSettings | None = None) -> None:
        super().__init__(settings)
        self._detected_base_sides: tuple[str, ...] = ("none",) * len(self.views)
        self._tissue = False

    @property
    def outputs(self) -> tuple[str, ...]:
        """See `NetworkEstimator`."""
        return (*COMPACT_OUTPUTS, *TISSUE_OUTPUTS) if self._tissue else COMPACT_OUTPUTS

    def resolve_settings(self, dataset: Dataset) -> None:
        """Finds whether there are classes of tissue, and the border of the base if the metadata do not state it.

        Where the border cannot be detected, whole images are used.
        """
        initial = self.initial_model()
        stated = [info.tissue.stiffness_n_per_m for info in dataset.session_info.values()]
        stiffness = [value for value in stated if value is not None]
        initial_has_classes = initial is not None and TissueEvidence.of(initial.arrays) is not None
        differs = bool(stiffness) and max(stiffness) > MIN_STIFFNESS_RATIO * min(stiffness)
        self._tissue = initial_has_classes or differs
        self.detect_base_sides(dataset)

    def detect_base_sides(self, dataset: Dataset) -> None:
        """Detects the border of the base in each view for which some session does not state it."""
        base_sides = list(self._detected_base_sides)
        for place, view in enumerate(self.views):
            unstated = [name for name, info in dataset.session_info.items() if info.view(view).base_side is None]
            if self.settings.base_side != "auto" or not unstated:
                continue
            index = spread_evenly(np.flatnonzero(np.isin(dataset.session, unstated)), _CALIBRATION_IMAGES)
            contents = [observation.views.get(view) for observation in dataset.subset(index).observations()]
            images = [image for image in contents if isinstance(image, np.ndarray)]
            try:
                base_sides[place] = auto_calibrate(VisionSettings(view=view), images).base_side
            except InputError:
                base_sides[place] = "none"
        self._detected_base_sides = tuple(base_sides)

    def input_specs(self, *, training: bool) -> Specs:
        """See `NetworkEstimator`: the window, larger for training, and the metadata features."""
        side = self._side(training=training)
        label: Specs = {"tissue": ((1,), "float32")} if training else {}
        return {"image": self._image_spec(side), "metadata": ((len(self.metadata_features),), "float32"), **label}

    def _image_spec(self, side: int) -> Spec:
        return ((side, side) if len(self.views) == 1 else (len(self.views), side, side)), "uint8"

    def metadata_names(self, dataset: Dataset) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """See `NetworkEstimator`. Keys that all training sessions stated are required: a default could be wrong."""
        stated = [info.stated_keys() for info in dataset.session_info.values()]
        names = [name for name in dict.fromkeys(itertools.chain(*stated)) if name in self._used_metadata()]
        return tuple(name for name in names if all(name in keys for keys in stated)), tuple(names)

    def _used_metadata(self) -> tuple[str, ...]:
        """Returns the keys of the session metadata that it uses."""
        catheter = ("diameter_m", "flexible_length_m", "rigid_length_m", "bending_stiffness_nm2")
        window = ("metres_per_px", "base_side") if self.settings.base_side == "auto" else ("metres_per_px",)
        of_views = (f"views.{view}.{name}" for view in self.views for name in (*window, *self.view_metadata))
        return (*(f"catheter.{name}" for name in catheter), *of_views, _KNOB_GAIN)

    @property
    def required_actuation(self) -> tuple[str, ...]:
        """Actuation that it was trained with; the knob, too, where its gain is required. Raises NotFittedError."""
        fitted = self._fitted()
        return tuple(dict.fromkeys((*fitted.actuation, *self.further_actuation(self.required_metadata))))

    def further_actuation(self, required_metadata: Sequence[str]) -> tuple[str, ...]:
        """See `NetworkEstimator`: the knob, whose gain makes a curvature of it."""
        return (KNOB,) if _KNOB_GAIN in required_metadata else ()

    def heatmap_spec(self) -> Spec:
        """See `NetworkEstimator`: a quarter of the image's size."""
        return self._image_spec(self._side(training=True) // 4)

    def _side(self, *, training: bool) -> int:
        size = self.settings.size
        return 8 * round(_TRAINING_SIZE * size / 8) if training else size

    def reader(self, info: SessionInfo, *, training: bool) -> InputReader:
        """Returns a function that reads the inputs of one sample; see `NetworkEstimator`.

        They are the window around the catheter in each view, and the metadata features; for training also the heatmap
        of the masks and the tissue. A fitted network gets only metadata that its training stated.
        """
        side = self._side(training=training)
        missing, detected_base_sides = "", self._detected_base_sides
        if not training and self.fitted_ is not None:
            missing = missing_metadata(self.required_metadata, info)
            info = info.only(self.fitted_.facts.known_metadata)
            detected_base_sides = self._stored_base_sides()
        needs_knob = bool(info.actuation.knob_gain_per_m_deg)
        tissue = np.array([math.log(info.tissue.stiffness_n_per_m or math.nan)], np.float32)
        windows = [
            _ViewWindow(info, view, base_side, self.settings, side)
            for view, base_side in zip(self.views, detected_base_sides, strict=True)
        ]

        def read(observation: Observation, masks: Masks | None = None) -> Arrays | Abstention:
            """Returns the inputs by name, or the reason why they cannot be read."""
            views = self.read_views(observation)
            if isinstance(views, Abstention):
                return views
            if missing:
                return Abstention(Status.MISSING_INPUT, missing)
            knob = read_actuation(observation, (KNOB,)) if needs_knob else None
            if isinstance(knob, Abstention):
                return knob
            advance_m = read_advance_m(observation)
            if isinstance(advance_m, Abstention):
                return advance_m
            now = [window.at(view.shape[:2], advance_m) for window, view in zip(windows, views, strict=True)]
            shape, _ = self._image_spec(side)
            images = [crop_window(view, window, side) for view, window in zip(views, now, strict=True)]
            inputs: Arrays = {
                "image": np.reshape(images, shape),
                "metadata": self.read_metadata(info, observation.actuation),
            }
            if training:
                inputs["tissue"] = tissue
            shape, _ = self._image_spec(side // 4)
            if training and masks is None:
                inputs["heatmap"] = np.full(shape, HEATMAP_UNKNOWN, np.uint8)
            elif masks is not None:
                binary = [np.where(mask, np.uint8(255), np.uint8(0)) for mask in masks]
                quarters = [crop_window(mask, window, side // 4) for mask, window in zip(binary, now, strict=True)]
                inputs["heatmap"] = np.reshape(quarters, shape)
            return inputs

        return read

    def read_views(self, observation: Observation) -> list[Image] | Abstention:
        """Returns the images of `views`, or why one of them cannot be read."""
        view = read_image(observation, self.settings.view, "view")
        return view if isinstance(view, Abstention) else [view]

    def read_metadata(self, info: SessionInfo, actuation: Mapping[str, float]) -> npt.NDArray[np.float32]:
        """Returns the values of `metadata_features`.

        Args:
            info: metadata of the session.
            actuation: readings of the drives by name.
        """
        return metadata_features(info, actuation)

    def _stored_base_sides(self) -> tuple[str, ...]:
        """Returns the border at which the base was detected in training, for each view."""
        stored = np.atleast_1d(self._fitted().arrays["detected_base_side"])
        return tuple(map(str, stored.tolist()))

    def task(self, known: BoolArray, base_frame: bool, actuation: tuple[tuple[float, float], ...]) -> CompactTask:
        """Returns the network to train; forces in the base frame may be mirrored about x; see `NetworkEstimator`."""
        return CompactTask(
            outputs=int(known.sum()),
            metadata=len(self.metadata_features),
            size=self.settings.size,
            planar=(0, 1) if base_frame and bool(known[:2].all()) else None,
            augmentation=self.settings.augmentation,
            actuation=actuation,
            tissue=self._tissue,
        )

    def fit_arrays(self, calibration: CalibrationBatch) -> Arrays:
        """Returns the fitted arrays of uncertainty, abstention limits, rate compensation and tissue.

        The detector and the uncertainty are fitted on outputs for training images, all else on held-out ones. Images as
        they are augmented in training count as in distribution, except for its out-of-distribution ones.
        """
        augmentation = self.settings.augmentation
        task = calibration.task
        assert isinstance(task, CompactTask)
        in_distribution = augmentation.model_copy(update={"out_of_distribution": 0.0})
        calibration = replace(calibration, task=replace(task, augmentation=in_distribution))
        held_out = calibration.outputs(held_out=True, augmented=False)
        training = calibration.outputs(held_out=False, augmented=True)
        threshold_grid = calibration.outputs(held_out=True, augmented=True)["grid"]
        initial = self.initial_model()
        initial_ood = None if initial is None else OodDetector.of(initial.arrays)
        ood = fit_ood_detector(training["grid"], held_out["grid"], threshold_grid, initial_ood)
        # the uncertainty of the initial model still holds if its distribution contains the new images
        still_holds = initial is not None and len(ood.distributions) > 1
        laplace = fit_laplace(
            training["features"], LastLayerLaplace.of(initial.arrays) if initial is not None and still_holds else None
        )
        sigma_n = component_sigma(held_out, laplace, COMPACT_UNIT_N)  # (n, t) standard deviations of held-out estimates
        forces = held_out["force_n"].astype(np.float64)
        size_sigma_n = np.array([magnitude_sigma(f, np.diag(s * s)) for f, s in zip(forces, sigma_n, strict=True)])
        heatmap_trained = "heatmap_logit" in self.outputs and (
            calibration.samples.heatmap is not None
            or (initial is not None and bool(initial.arrays["min_heatmap_px"] > 0))
        )
        truth = calibration.samples.force_n[calibration.held_out].astype(np.float64)
        errors = np.linalg.norm(forces, axis=1) - np.linalg.norm(truth, axis=1)
        limits = fit_abstention_limits(
            held_out,
            size_sigma_n,
            self.settings.abstained,
            heatmap_trained=heatmap_trained,
            ood_trained=augmentation.out_of_distribution > 0,
        )
        if initial is not None and still_holds:
            limits = limits.widened(_limits(initial.arrays))
        trusted_n = largest_trusted_sigma(size_sigma_n, errors, self.settings.max_error_n)
        limits = replace(limits, max_sigma_n=min(limits.max_sigma_n, trusted_n))
        compensation = rate_compensation_from(
            calibration, None if initial is None else _rate_compensation(initial.arrays)
        )
        evidence = self._tissue_evidence(calibration, None if initial is None else TissueEvidence.of(initial.arrays))
        return {
            **({} if evidence is None else evidence.arrays()),
            **ood.arrays(),
            **laplace.arrays(),
            "min_heatmap_px": np.array(limits.min_heatmap_px),
            "max_sigma_n": np.array(limits.max_sigma_n),
            "min_in_distribution_logit": np.array(limits.min_in_distribution_logit),
            "typical_sigma_n": np.append(np.median(sigma_n, axis=0), np.median(size_sigma_n)),
            "rate_compensation_s": compensation.seconds,
            "sigma_factor_without_history": np.array(compensation.sigma_factor_without_history),
            "detected_base_side": np.array(self._detected_base_sides).squeeze(),
        }

    def _tissue_evidence(self, calibration: CalibrationBatch, initial: TissueEvidence | None) -> TissueEvidence | None:
        """Fits the evidence on the tissue to the validation samples; None for a network without classes of tissue."""
        if not self._tissue:
            return None
        samples, held_out = calibration.samples, calibration.split.val
        logits = calibration.at(held_out, names=("tissue_logits",))["tissue_logits"]
        log_stiffness = samples.inputs["tissue"][held_out, 0].astype(np.float64)
        return fit_tissue_evidence(
            samples.session[held_out], calibration.stamp_ns[held_out], logits, log_stiffness, initial
        )

    def start(self, info: SessionInfo, images: Sequence[Image] = ()) -> "CompactStream":
        """Returns a stream for one session; see `Estimator.start`."""
        del images  # its window follows from the metadata
        reader, builder = self.reader(info, training=False), self.estimate_builder(info)
        return CompactStream(self._fitted(), reader, builder, self.required_actuation, info, self.views)

    def estimate_builder(self, info: SessionInfo) -> CompactEstimateBuilder:
        """Returns a builder of one session's estimates, with the stored uncertainty, limits and tissue evidence."""
        fitted = self._fitted()
        evidence = TissueEvidence.of(fitted.arrays)
        return CompactEstimateBuilder(
            known=fitted.known,
            unit_n=COMPACT_UNIT_N,
            laplace=LastLayerLaplace.of(fitted.arrays),
            ood=OodDetector.of(fitted.arrays),
            limits=_limits(fitted.arrays),
            interval=fitted.interval,
            compensation=_rate_compensation(fitted.arrays),
            history=History(),
            tissue=None if evidence is None else TissueBelief(evidence, info.tissue.stiffness_n_per_m),
        )

    def check_outputs(self, outputs: Outputs) -> None:
        """Computes from ``outputs`` for one image all that an estimate needs. Raises KeyError or ValueError."""
        fitted = self._fitted()
        count = int(fitted.known.sum())
        component_sigma(outputs, LastLayerLaplace.of(fitted.arrays), COMPACT_UNIT_N)
        OodDetector.of(fitted.arrays).score(outputs["grid"])
        if "heatmap_logit" in self.outputs:
            heatmap_pixels(outputs)
        stored_array(fitted.arrays, "typical_sigma_n", (count + 1,), low=0.0)
        if _rate_compensation(fitted.arrays).seconds.shape != (count, count):
            raise ValueError(f"rate_compensation_s is no matrix for {count} components")
        for side in self._stored_base_sides():
            if side not in (*BASE_SIDES, "none"):
                raise ValueError(f"detected_base_side is {side[:20]!r}, no border of an image")
        for name in ("in_distribution_logit", "contact_logit"):
            if outputs[name].shape != (1,):
                raise ValueError(f"the graph gives {name} of the shape {outputs[name].shape}, expected (1,)")
        self.estimate_builder(SessionInfo())(0, outputs)

    @property
    def uses_history(self) -> bool:
        """True where it was trained on frames that follow each other closely, or learns the session's tissue."""
        if self.fitted_ is None:
            return False
        return _rate_compensation(self.fitted_.arrays).used or TissueEvidence.of(self.fitted_.arrays) is not None

    def fit_interval(
        self, estimates: Sequence[ForceEstimate], truth: FloatArray, session: npt.NDArray[np.str_], sampling: str
    ) -> Interval:
        """Returns the intervals in standard deviations of each estimate.

        Held-out samples of the training sessions guarantee little for other sessions. So a fine-tuned network keeps the
        interval of its initial model where that is wider, unless whole sessions were held out.

        Args:
            estimates: n estimates.
            truth: (n, t) their labels in newtons, of the components that the labels know.
            session: (n,) their sessions.
            sampling: how the samples were drawn; "": whole sessions were held out.
        """
        known = self._fitted().known
        force = np.array([each.force_n[known] for each in estimates])
        covariance = np.array([each.covariance_n2[np.ix_(known, known)] for each in estimates])
        interval = normalised_interval(known, force, covariance, truth, session, sampling)
        initial = self.initial_model()
        whole_sessions = not sampling
        return interval if initial is None or whole_sessions else wider_interval(interval, initial.interval)

    def typical_half_n(self) -> FloatArray:
        """See `NetworkEstimator`: at the typical uncertainty."""
        fitted = self._fitted()
        half_widths = np.append(fitted.interval.half_n[fitted.known], fitted.interval.magnitude_half_n)
        return half_widths * fitted.arrays["typical_sigma_n"]

    def typical_unit_n(self) -> float:
        """See `NetworkEstimator`: the typical standard deviation of the magnitude."""
        return float(self._fitted().arrays["typical_sigma_n"][-1])


class CompactStream(NetworkStream):
    """One session, frame after frame.

    The images of a session are of one bench: where most of them are unlike the training's, the others only seem to be
    like them, and have no estimate either.
    """

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._in_distribution = RecentShare(_IN_DISTRIBUTION_S)
        self._last_ns: int | None = None

    def update(self, observation: Observation) -> ForceEstimate:
        """Returns the force on the next frame; see `Stream.update`.

        Invalid, too, where most images of the last seconds (`_IN_DISTRIBUTION_S`) were out of distribution.
        """
        outputs = self.outputs(observation)
        if isinstance(outputs, ForceEstimate):
            return outputs
        assert isinstance(self._build, CompactEstimateBuilder)
        estimate = self._build(observation.stamp_ns, outputs)
        last_ns = observation.stamp_ns if self._last_ns is None else self._last_ns
        elapsed_s, self._last_ns = max(0.0, 1e-9 * (observation.stamp_ns - last_ns)), observation.stamp_ns
        self._in_distribution.add(estimate.status is not Status.OUT_OF_DISTRIBUTION, elapsed_s)
        if estimate.valid and self._in_distribution.value < MIN_IN_DISTRIBUTION_SHARE:
            detail = f"only {self._in_distribution.value:.0%} of the last images are like those of the training"
            return ForceEstimate.invalid(observation.stamp_ns, Status.OUT_OF_DISTRIBUTION, detail)
        return estimate


def _rate_compensation(arrays: Arrays) -> RateCompensation:
    return RateCompensation(
        stored_array(arrays, "rate_compensation_s", (None, None), low=-MAX_COMPENSATION_S, high=MAX_COMPENSATION_S),
        stored_number(arrays, "sigma_factor_without_history", low=0.0),
    )


def _limits(arrays: Arrays) -> AbstentionLimits:
    return AbstentionLimits(
        min_heatmap_px=stored_number(arrays, "min_heatmap_px", low=0.0),
        max_sigma_n=stored_number(arrays, "max_sigma_n", low=0.0),
        min_in_distribution_logit=stored_number(arrays, "min_in_distribution_logit", low=-math.inf),
    )
