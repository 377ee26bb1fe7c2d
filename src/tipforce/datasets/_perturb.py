"""Perturbed data: images under conditions that differ from training, and the force that belongs to them."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import cv2
import numpy as np

from ..errors import InputError
from ..types import FloatArray, Image, IntArray, Observation, ShapeFeatures, View
from ._dataset import Dataset, RowStore


class ImageOperation(Protocol):
    """Changes an image; gives the same result for the same seed. Comparable and hashable."""

    def __call__(self, image: Image, seed: tuple[int, int]) -> Image:
        """Returns the changed image.

        Args:
            image: (h, w) or (h, w, 3), uint8.
            seed: seed of the random numbers, different for each image.

        Returns:
            An image of the same shape.
        """
        ...


@dataclass(frozen=True, slots=True)
class Warp:
    """Turns and enlarges about the middle of the image, then shifts; borders are replicated.

    Attributes:
        right_px: shift to the right.
        down_px: shift down.
        turn_deg: angle, counter-clockwise.
        zoom: factor of enlargement.
    """

    right_px: float = 0.0
    down_px: float = 0.0
    turn_deg: float = 0.0
    zoom: float = 1.0

    def __call__(self, image: Image, seed: tuple[int, int]) -> Image:  # noqa: ARG002 - nothing is drawn
        """Returns the image, bilinearly sampled."""
        height, width = image.shape[:2]
        matrix = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), self.turn_deg, self.zoom)
        matrix[:, 2] += self.right_px, self.down_px
        return cv2.warpAffine(image, matrix, (width, height), borderMode=cv2.BORDER_REPLICATE)  # type: ignore[return-value]


@dataclass(frozen=True, slots=True)
class Light:
    """Changes the brightness.

    Attributes:
        factor: factor of all grey levels.
        slope: grey levels also change by the factor 1 - ``slope`` at the left border to 1 + ``slope`` at the right.
    """

    factor: float = 1.0
    slope: float = 0.0

    def __call__(self, image: Image, seed: tuple[int, int]) -> Image:  # noqa: ARG002 - nothing is drawn
        """Returns the image, saturated at 255."""
        ramp = self.factor * np.linspace(1 - self.slope, 1 + self.slope, image.shape[1], dtype=np.float32)
        return _bytes(image * (ramp if image.ndim == 2 else ramp[:, None]))


@dataclass(frozen=True, slots=True)
class Blur:
    """Blurs with a Gaussian of ``sigma_px``."""

    sigma_px: float

    def __call__(self, image: Image, seed: tuple[int, int]) -> Image:  # noqa: ARG002 - nothing is drawn
        """Returns the blurred image."""
        return cv2.GaussianBlur(image, (0, 0), self.sigma_px, borderType=cv2.BORDER_REPLICATE)  # type: ignore[return-value]


@dataclass(frozen=True, slots=True)
class Noise:
    """Adds white Gaussian noise of ``sigma`` grey levels, independent for each colour."""

    sigma: float

    def __call__(self, image: Image, seed: tuple[int, int]) -> Image:
        """Returns the image with the noise of this ``seed``."""
        grain = np.random.default_rng(seed).standard_normal(image.shape, dtype=np.float32)
        return _bytes(image + self.sigma * grain)


@dataclass(frozen=True, slots=True)
class Disc:
    """Draws an even disc of random position and grey level; its diameter is a ``share`` of the image's height."""

    share: float

    def __call__(self, image: Image, seed: tuple[int, int]) -> Image:
        """Returns the image with the disc at the position of this ``seed``."""
        draw = np.random.default_rng(seed)
        height, width = image.shape[:2]
        middle = int(draw.integers(width)), int(draw.integers(height))
        radius, grey = max(1, round(0.5 * self.share * height)), float(draw.integers(256))
        return cv2.circle(image.copy(), middle, radius, (grey, grey, grey), cv2.FILLED, cv2.LINE_AA)  # type: ignore[return-value]


def _bytes(image: np.ndarray) -> Image:
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


@dataclass(frozen=True, slots=True)
class Perturbation:
    """A change of the images, and the change of the force that belongs to it.

    Attributes:
        kind: name of the kind; perturbations that differ only in ``way`` are one line of a table.
        size: size of the change, as text.
        operation: the change of the image.
        way: direction of the change, as text.
        force_turn_deg: angle by which the force is turned about the base frame's z axis.
    """

    kind: str
    size: str
    operation: ImageOperation
    way: str = ""
    force_turn_deg: float = 0.0

    def force(self, force_n: FloatArray) -> FloatArray:
        """Returns the force (n, 3) under this perturbation.

        >>> quarter = Perturbation("turn", "90 deg", Warp(turn_deg=90), force_turn_deg=90)
        >>> quarter.force(np.array([[0.2, 0.0, 0.1]])).round(3).tolist()
        [[0.0, 0.2, 0.1]]
        """
        angle = np.radians(self.force_turn_deg)
        x, y = force_n[:, 0], force_n[:, 1]
        rotated = np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y
        return np.column_stack([*rotated, force_n[:, 2]]) if self.force_turn_deg else force_n


def _standard_perturbations() -> Iterator[Perturbation]:
    """Yields each kind of change in three sizes, and shifts and turns in each direction; see `PERTURBATIONS`."""
    for px in (10, 20, 40):
        for way, right, down in (("right", 1, 0), ("left", -1, 0), ("down", 0, 1), ("up", 0, -1)):
            yield Perturbation("shift", f"{px} px", Warp(px * right, px * down), way)
    for kind, force_turns in (("turn", False), ("turn, force turned along", True)):
        for degrees in (5, 15, 45):
            for way, sign in (("counter-clockwise", 1), ("clockwise", -1)):
                turn_deg = sign * degrees
                force_turn_deg = float(turn_deg) if force_turns else 0.0
                yield Perturbation(kind, f"{degrees}°", Warp(turn_deg=turn_deg), way, force_turn_deg)
    for factor in (0.9, 1.1, 1.25):
        yield Perturbation("zoom", f"× {factor:g}", Warp(zoom=factor))
    for light, size in ((Light(0.6), "× 0.6"), (Light(1.4), "× 1.4"), (Light(slope=0.4), "× 0.6 to 1.4 across")):
        yield Perturbation("light", size, light)
    for sigma_px in (1, 2, 4):
        yield Perturbation("blur", f"{sigma_px} px", Blur(float(sigma_px)))
    for sigma_levels in (5, 10, 20):
        yield Perturbation("noise", f"{sigma_levels} levels", Noise(float(sigma_levels)))
    for percent_of_height in (5, 10, 20):
        yield Perturbation("object", f"{percent_of_height} %", Disc(percent_of_height / 100))


PERTURBATIONS = tuple(_standard_perturbations())
"""Shifts, turns, zooms, light, blur, noise and an object in view (diameter as a share of the height); three sizes each.

"turn": the whole bench is turned under the camera, so the force in the base frame stays. "turn, force turned along":
the force is turned, too, as for labels in the image's axes.
"""


def perturbed(dataset: Dataset, perturbation: Perturbation, seed: int = 0) -> Dataset:
    """Returns ``dataset`` under a perturbation; reading it raises InputError if a view is not an image.

    Args:
        dataset: a dataset with images.
        perturbation: the change of images and force.
        seed: seed of the noise and of the object's position; the same seed gives the same images.
    """
    return replace(
        dataset,
        store=_Perturbed(dataset.store, perturbation.operation, seed, dataset.title),
        force_n=perturbation.force(dataset.force_n),
        whole=None,
        _memo={},
        _fingerprints=dataset.session_fingerprints,
    )


def in_memory(dataset: Dataset) -> Dataset:
    """Returns ``dataset`` with its observations in memory, for repeated reading."""
    observations = dict(zip(dataset.rows.tolist(), dataset.observations(), strict=True))
    return replace(
        dataset, store=_InMemory(observations), whole=None, _memo={}, _fingerprints=dataset.session_fingerprints
    )


@dataclass(frozen=True, slots=True)
class _InMemory:
    observations: dict[int, Observation]

    def read(self, rows: IntArray) -> Iterator[Observation]:
        return (self.observations[row] for row in rows.tolist())


@dataclass(frozen=True, slots=True)
class _Perturbed:
    store: RowStore
    operation: ImageOperation
    seed: int
    title: str

    def read(self, rows: IntArray) -> Iterator[Observation]:
        for row, observation in zip(rows.tolist(), self.store.read(rows), strict=True):
            views = {name: self._changed(view, row) for name, view in observation.views.items()}
            yield replace(observation, views=views)

    def _changed(self, view: View, row: int) -> View:
        if isinstance(view, ShapeFeatures):
            raise InputError(f"{self.title}: holds ready-made shape numbers, and only images can be perturbed")
        return self.operation(view, (self.seed, row))
