"""Events of a bench, and the observations of an estimator."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from ._arrays import FloatArray, Image, frozen

JOINTS = "joints"
"""Stream of the readings of the catheter's own drives."""
STAGE = "stage"
"""Stream of the positions of the stage that moves the tissue at a bench."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One image of one camera.

    Attributes:
        stamp_ns: mid-exposure, on the recording's clock.
        image: (h, w) grey or (h, w, 3) RGB, uint8.
        view: name of the camera.
        max_delay_ns: the driver guarantees that mid-exposure was at most this much before ``stamp_ns``; 0 where it
            knows the time of the exposure.
    """

    stamp_ns: int
    image: Image
    view: str = "camera"
    max_delay_ns: int = 0

    def __post_init__(self) -> None:
        if self.image.dtype != np.uint8 or not (self.image.ndim == 2 or self.image.shape[2:] == (3,)):
            raise ValueError(f"image: expected uint8 (h, w) or (h, w, 3), got {self.image.dtype} {self.image.shape}")


@dataclass(frozen=True, slots=True, eq=False)
class Wrench:
    """One reading of a force sensor: ``force_n`` (3,) and ``torque_nm`` (3,), in the frame that ``frame`` names."""

    stamp_ns: int
    force_n: FloatArray
    torque_nm: FloatArray
    frame: str = "base"

    def __post_init__(self) -> None:
        object.__setattr__(self, "force_n", frozen("force_n", self.force_n, (3,)))
        object.__setattr__(self, "torque_nm", frozen("torque_nm", self.torque_nm, (3,)))


@dataclass(frozen=True, slots=True)
class Actuation:
    """Readings of drives at one instant; every name ends in its unit, as in ``knob_deg``.

    Attributes:
        stamp_ns: time of the readings.
        values: NAME_UNIT -> reading.
        stream: `JOINTS` for the catheter's drives; `STAGE` for the stage that moves the tissue at a bench. The latter
            serves to subtract the inertia from the readings of the sensor; no estimator gets it, because the motion of
            a heart is not measured.
    """

    stamp_ns: int
    values: Mapping[str, float]
    stream: str = JOINTS


Event = Frame | Wrench | Actuation
"""Event of a `Source`; each stream is in the order of its stamps."""


@dataclass(frozen=True, slots=True, eq=False)
class ShapeFeatures:
    """A view that was reduced to shape numbers elsewhere: ``values`` (k,) and the name of each.

    It replaces an image for data that come as ready-made coefficients (thesis eq. 2).
    """

    names: tuple[str, ...]
    values: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", frozen("values", self.values, (len(self.names),)))


View = Image | ShapeFeatures


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """Everything that an estimator gets of one instant; it contains no label.

    Attributes:
        stamp_ns: stamp of the frame.
        views: name -> image (h, w[, 3]) uint8 or `ShapeFeatures`.
        actuation: ``NAME_UNIT`` -> value.
    """

    stamp_ns: int
    views: Mapping[str, View]
    actuation: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
