"""Method 2: the deep catheter force estimator, a ResNet-18 from the whole picture to the force (thesis ch. 4)."""

from typing import ClassVar

from ...training import RESNET_OUTPUTS, ResnetTask
from ...types import BoolArray, ForceEstimate, Image, Observation, SessionInfo, ShapeFeatures, Status
from .._answers import Answers
from .._reading import Refusal, read_view
from ._arrays import Arrays, Looked, Outputs, Reader
from ._domain import Domains, learn_domains, refused_as_strange
from ._network import Answering, NetworkEstimator
from ._pictures import SIDE, whole_picture
from ._prepared import Forms
from ._settings import DcfeSettings

__all__ = ["Dcfe"]

_FORCE_DIRECTIONS = 20
"""Of the pooled features: along these known pictures differ, the first holds nearly all of their variance."""


class Dcfe(NetworkEstimator):
    """Picture to Fx and Fy: 224 x 224 x 3, values 0..1 and nothing else; forces as they are, in newtons.

    The picture's aspect is not kept, as in the thesis; grey ones are repeated in three channels. Beyond the thesis, a
    picture whose pooled features lie far from all of the training's is refused. ``fitted_`` is None before ``fit``.
    """

    name: ClassVar[str] = "dcfe"
    settings_type = DcfeSettings
    settings: DcfeSettings
    thesis_samples: ClassVar[int] = 615
    outputs = RESNET_OUTPUTS

    def forms(self, *, training: bool) -> Forms:
        """The same in training and after."""
        del training
        return {"picture": ((SIDE, SIDE, 3), "uint8")}

    def reader(self, info: SessionInfo, *, training: bool) -> Reader:
        """The picture resized; nothing hangs on the session."""
        del info, training
        return self._read

    def task(self, known: BoolArray, in_base: bool, actuation: tuple[tuple[float, float], ...]) -> ResnetTask:
        """Thesis fig. 29 and eq. (19); the network learns forces of any frame."""
        del in_base
        return ResnetTask(int(known.sum()), actuation)

    def own_arrays(self, looked: Looked) -> Arrays:
        """Which pictures it knows."""
        taught, kept = (looked.outputs(kept=part, altered=False)["pooled"] for part in (False, True))
        begun = self.begun()
        before = None if begun is None else Domains.of(begun.own)
        return learn_domains(taught, kept, kept, before, beside=_FORCE_DIRECTIONS).arrays()

    def answering(self) -> Answering:
        """Estimates, or a refusal of what is unlike the training."""
        fitted = self._known()
        answers, domains = Answers(fitted.known, fitted.interval), Domains.of(fitted.own)

        def answer(stamp_ns: int, outputs: Outputs) -> ForceEstimate:
            strange = refused_as_strange(stamp_ns, domains, outputs["pooled"])
            return answers.valid(stamp_ns, outputs["force_n"][0]) if strange is None else strange

        return answer

    def _read(self, observation: Observation, mask: Image | None = None) -> Arrays | Refusal:
        del mask
        view = read_view(observation, self.settings.view, "view")
        if isinstance(view, Refusal):
            return view
        if isinstance(view, ShapeFeatures):
            return Refusal(
                Status.MISSING_INPUT, "this method looks at pictures; these data are ready-made shape numbers"
            )
        return {"picture": whole_picture(view)}
