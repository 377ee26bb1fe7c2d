"""Method `fusion`: the session model, with the geometry of the contact as one more measurement.

The shape shows the force across the shaft well, and little of the force along it. The image at the tip shows the
tissue: a network reads contact, the direction of the force and the depth of the indentation, each with its uncertainty
(`tipforce.vision.contact`). It knows neither stiffness nor tissue; the session learns the tissue's law from frames in
which shape and direction show the force. So direction and depth give the part along the shaft. Where the image shows no
tissue, and under X-ray, the reading says nothing, and the method is `rod-track`.
"""

from dataclasses import replace
from typing import Annotated, ClassVar

from pydantic import Field

from ._facts import ModelSummary
from .session import ContactSettings, RodFacts, RodTrack, RodTrackSettings


class FusionSettings(RodTrackSettings):
    """Settings of `fusion`."""

    contact: ContactSettings = ContactSettings(read=True)
    max_error_n: Annotated[float, Field(gt=0, le=100)] | None = 0.1


class FusionFacts(RodFacts, frozen=True):
    """Facts of `fusion`: those of the rod."""

    def summary(self) -> ModelSummary:
        """Returns the origin of the priors and the basis of the intervals."""
        inputs = "The detected centreline, the image at the tip, the knob, the stated stiffness and length."
        return replace(super().summary(), inputs=inputs, short_inputs="image, centreline and knob")


class Fusion(RodTrack):
    """See the module."""

    name: ClassVar[str] = "fusion"
    settings_type = FusionSettings
    facts_type = FusionFacts
    breaks: ClassVar[str] = (
        "Where the line is detected wrongly, or the tip is pushed along the shaft and no tissue is visible."
    )
