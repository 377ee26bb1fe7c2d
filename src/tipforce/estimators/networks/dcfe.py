"""Method 2: the deep catheter force estimator, a ResNet-18 from the whole image to the force (thesis ch. 4)."""

from collections.abc import Mapping
from typing import Any, ClassVar

from ...training import RESNET_OUTPUTS, ResnetTask
from ...types import BoolArray, ForceEstimate, Observation, SessionInfo
from .._builder import EstimateBuilder
from .._reading import Abstention, read_image
from ..uncertainty import OodDetector, fit_ood_detector
from ._calibration import CalibrationBatch, Outputs
from ._image_input import RESNET_SIZE_PX, resize_to_resnet
from ._network import BuildEstimate, NetworkEstimator
from ._preparation import Arrays, InputReader, Masks, Specs
from ._settings import DcfeSettings

_IGNORED_DIRECTIONS = 20
"""Principal directions of the pooled features along which in-distribution images differ: the first holds nearly all of
their variance."""


class Dcfe(NetworkEstimator):
    """Image to Fx and Fy: 224 x 224 x 3, values 0..1 and nothing else; forces in newtons as they are.

    The image's aspect ratio is not kept, as in the thesis; grey images are repeated in three channels. Beyond the
    thesis, a tenth of the images is held out by default, which ends training early, gives the intervals, and shows
    from when on an image is out of distribution: then there is no estimate. ``fitted_`` is None before ``fit``.
    """

    name: ClassVar[str] = "dcfe"
    settings_type = DcfeSettings
    settings: DcfeSettings
    thesis_samples: ClassVar[int] = 615
    thesis_settings: ClassVar[Mapping[str, Any] | None] = {
        "validation": 0,
        "patience": None,
        "schedule": "cosine",
        "batch": 32,
    }
    """The thesis names no batch size and no schedule: 32 is the default of TensorFlow 2.0, which it used, and a rate
    that falls to 0 ends training in a rest without a validation part."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """See `NetworkEstimator`."""
        return RESNET_OUTPUTS

    def input_specs(self, *, training: bool) -> Specs:
        """See `NetworkEstimator`; the same in training and after."""
        del training
        return {"image": ((RESNET_SIZE_PX, RESNET_SIZE_PX, 3), "uint8")}

    def reader(self, info: SessionInfo, *, training: bool) -> InputReader:
        """See `NetworkEstimator`; the resized image, the same for all sessions."""
        del info, training
        return self._read

    def task(self, known: BoolArray, base_frame: bool, actuation: tuple[tuple[float, float], ...]) -> ResnetTask:
        """See `NetworkEstimator`: thesis fig. 29 and eq. (19), with forces of any frame."""
        del base_frame
        return ResnetTask(int(known.sum()), actuation)

    def fit_arrays(self, calibration: CalibrationBatch) -> Arrays:
        """Fits the out-of-distribution detector."""
        training, held_out = (
            calibration.outputs(held_out=held_out, augmented=False)["pooled"] for held_out in (False, True)
        )
        initial = self.initial_model()
        before = None if initial is None else OodDetector.of(initial.arrays)
        detector = fit_ood_detector(training, held_out, held_out, before, ignored_directions=_IGNORED_DIRECTIONS)
        return detector.arrays()

    def estimate_builder(self, info: SessionInfo) -> BuildEstimate:
        """See `NetworkEstimator`; abstains where an image is out of distribution, if a validation part showed when."""
        fitted = self._fitted()
        if not self.settings.validation:
            return super().estimate_builder(info)
        builder, detector = EstimateBuilder(fitted.known, fitted.interval), OodDetector.of(fitted.arrays)

        def build(stamp_ns: int, outputs: Outputs) -> ForceEstimate:
            abstention = detector.abstention(stamp_ns, outputs["pooled"])
            return builder.valid(stamp_ns, outputs["force_n"][0]) if abstention is None else abstention

        return build

    def check_outputs(self, outputs: Outputs) -> None:
        """See `NetworkEstimator`."""
        fitted = self._fitted()
        if self.settings.validation:
            OodDetector.of(fitted.arrays).score(outputs["pooled"])
        EstimateBuilder(fitted.known, fitted.interval).valid(0, outputs["force_n"][0])

    def _read(self, observation: Observation, masks: Masks | None = None) -> Arrays | Abstention:
        del masks
        view = read_image(observation, self.settings.view, "view")
        if isinstance(view, Abstention):
            return view
        return {"image": resize_to_resnet(view)}
