"""A catheter that a person marked in one image: training material for the locator."""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..types import FloatArray, frozen

MIN_POINTS = 2


@dataclass(frozen=True, slots=True, eq=False)
class Annotation:
    """The catheter in one image, as a person marked it.

    Attributes:
        image: name of the image, unique among the annotations that are used together.
        points_px: (k, 2) points on the catheter's centreline (u, v) in px, in order from base to tip, at least two;
            the first is at the base, the last at the tip. (0, 2) where no catheter is in the image.
        tip_hidden: whether the tip is behind something: then the last point is a guess.
        present: whether a catheter is in the image.

    Raises:
        InputError: the points have another shape, are not finite, do not follow each other, or do not fit ``present``.
    """

    image: str
    points_px: FloatArray
    tip_hidden: bool = False
    present: bool = True

    def __post_init__(self) -> None:
        points = np.asarray(self.points_px, np.float64)
        if not self.present:
            points = points.reshape(-1, 2) if points.size == 0 else points
            if points.size:
                raise InputError(
                    f"{self.image}: marked as an image without a catheter, but it has {len(points)} points; "
                    f"remove the points or the mark"
                )
        elif points.ndim != 2 or points.shape[1] != 2 or len(points) < MIN_POINTS:
            raise InputError(
                f"{self.image}: the catheter's line has the shape {points.shape}; expected at least {MIN_POINTS} "
                f"points (u, v) in px, from base to tip"
            )
        elif not np.isfinite(points).all():
            raise InputError(f"{self.image}: a point of the catheter's line is not a number; mark it again")
        elif not np.linalg.norm(np.diff(points, axis=0), axis=1).all():
            raise InputError(f"{self.image}: two points in a row of the catheter's line are the same; remove one")
        object.__setattr__(self, "points_px", frozen("points_px", points, (None, 2)))
