"""`stereo`: `compact` with two views: the force in three dimensions from two images of the same instant.

One encoder reads the windows of both views. Where all training images have masks of the catheter, the network also
learns to estimate them, and the model leaves that part out. The position of the views to each other is an input where
their projections are stated. An observation without one of the views has no estimate.
"""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from ...datasets import Dataset
from ...training import STEREO_OUTPUTS, StereoTask
from ...types import BoolArray, FloatArray, Image, Observation, SessionInfo, Status
from .._reading import Abstention, read_image
from ._image_input import BASE_SIDES
from ._settings import StereoSettings
from .compact import METADATA_FEATURES, Compact, metadata_features


class Stereo(Compact):
    """See the module. ``fitted_`` is None before ``fit``."""

    name: ClassVar[str] = "stereo"
    settings_type = StereoSettings
    settings: StereoSettings  # pyright: ignore[reportIncompatibleVariableOverride]
    input_text = "a window around the catheter in the images of two views, in grey"
    metadata_features = (*METADATA_FEATURES, "views_cosine", "views_sine")
    view_metadata = ("projection",)
    view_setting = ""

    def __init__(self, settings: StereoSettings | None = None) -> None:
        super().__init__(settings)  # pyright: ignore[reportArgumentType]

    @property
    def views(self) -> tuple[str, ...]:
        """Both views of the settings."""
        return self.settings.views

    @property
    def outputs(self) -> tuple[str, ...]:
        """See `NetworkEstimator`."""
        return STEREO_OUTPUTS

    def resolve_settings(self, dataset: Dataset) -> None:
        """Finds the border of the base in each view, if the metadata do not state it."""
        self.detect_base_sides(dataset)

    def read_views(self, observation: Observation) -> list[Image] | Abstention:
        """Returns the images of both views, or why one of them cannot be read."""
        first, second = self.views
        missing = [view for view in self.views if view not in observation.views]
        if missing:
            there = ", ".join(observation.views) or "none"
            which = f"view {missing[0]!r} has" if len(missing) == 1 else f"the views {first!r} and {second!r} have"
            detail = (
                f"{which} no image of this instant (there is {there}); stereo needs the images of both its views, "
                f"{first!r} and {second!r}, as the setting views names them"
            )
            return Abstention(Status.MISSING_INPUT, detail)
        images: list[Image] = []
        for view in self.views:
            image = read_image(observation, view, "views")
            if isinstance(image, Abstention):
                return image
            images.append(image)
        return images

    def read_metadata(self, info: SessionInfo, actuation: Mapping[str, float]) -> npt.NDArray[np.float32]:
        """Returns the values of `metadata_features`; see `Compact.read_metadata`."""
        return np.append(metadata_features(info, actuation), angle_between(info, self.views)).astype(np.float32)

    def task(self, known: BoolArray, base_frame: bool, actuation: tuple[tuple[float, float], ...]) -> StereoTask:
        """Returns the network to train; base-frame forces are mirrored with the image; see `NetworkEstimator`."""
        outputs = np.flatnonzero(known).tolist()
        return StereoTask(
            outputs=len(outputs),
            metadata=len(self.metadata_features),
            size=self.settings.size,
            augmentation=self.settings.augmentation,
            actuation=actuation,
            across=tuple(k for k, axis in enumerate(outputs) if axis > 0) if base_frame else None,
        )


def angle_between(info: SessionInfo, views: tuple[str, ...]) -> tuple[float, float]:
    """Returns cosine and sine of the angle by which the second view is turned about the catheter from the first one.

    It is the angle between the directions in space that are across the base tangent in each image.

    Args:
        info: metadata of the session: projections and borders of the base.
        views: names of the two views.

    Returns:
        Cosine and sine; both 0 where a projection, or the frame that both share, is not stated.
    """
    first, second = (info.view(view) for view in views)
    if first.projection is None or second.projection is None or first.projection_frame != second.projection_frame:
        return 0.0, 0.0
    along, across = _directions(np.array(first.projection), first.base_side)
    _, second_across = _directions(np.array(second.projection), second.base_side)
    depth = np.cross(along, across)
    cosine, sine = float(second_across @ across), float(second_across @ depth)
    length = np.hypot(cosine, sine)
    return (cosine / length, sine / length) if length > 0.0 else (0.0, 0.0)


def _directions(projection: FloatArray, base_side: str | None) -> tuple[FloatArray, FloatArray]:
    """Returns the unit directions (3,) in space along and across the base tangent, as the window shows them.

    Args:
        projection: (3, 4) matrix from metres to pixels.
        base_side: border at which the base is; None: the left one.
    """
    # gradients of u and v at the origin of the projection's frame
    rows, offsets = projection[:, :3], projection[:, 3]
    u, v = (rows[k] * offsets[2] - rows[2] * offsets[k] for k in (0, 1))
    u, v = u / np.linalg.norm(u), v / np.linalg.norm(v)
    # the window is the image, turned clockwise by quarter turns until the base is on the left
    for _ in range(BASE_SIDES.index(base_side or "left")):
        u, v = -v, u
    return u, v
