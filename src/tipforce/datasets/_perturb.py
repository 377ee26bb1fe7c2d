"""Data as they would be had something gone otherwise than in training: pictures disturbed, the force as it then is."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..types import FloatArray, IntArray, Observation, ShapeFeatures, View
from ._dataset import Dataset, RowStore
from ._image_operations import Blur, Disc, ImageOperation, Light, Noise, Warp

__all__ = ["PERTURBATIONS", "Perturbation", "in_memory", "perturbed"]


@dataclass(frozen=True, slots=True)
class Perturbation:
    """What happens to a picture, and what the force is then: turned by ``force_turn_deg`` about the base frame's z.

    ``kind``, ``size``, ``way``: how it is called; those that differ in their ways only are one line of a table.
    """

    kind: str
    size: str
    picture: ImageOperation
    way: str = ""
    force_turn_deg: float = 0.0

    def force(self, force_n: FloatArray) -> FloatArray:
        """``force_n`` (n, 3) as it is under this disturbance.

        >>> quarter = Perturbation("turn", "90 deg", Warp(turn_deg=90), force_turn_deg=90)
        >>> quarter.force(np.array([[0.2, 0.0, 0.1]])).round(3).tolist()
        [[0.0, 0.2, 0.1]]
        """
        angle = np.radians(self.force_turn_deg)
        x, y = force_n[:, 0], force_n[:, 1]
        turned = np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y
        return np.column_stack([*turned, force_n[:, 2]]) if self.force_turn_deg else force_n


def _all() -> Iterator[Perturbation]:
    for px in (10, 20, 40):
        for way, right, down in (("right", 1, 0), ("left", -1, 0), ("down", 0, 1), ("up", 0, -1)):
            yield Perturbation("shift", f"{px} px", Warp(px * right, px * down), way)
    for kind, along in (("turn", 0), ("turn, force turned along", 1)):
        for degrees in (5, 15, 45):
            for way, sign in (("counter-clockwise", 1), ("clockwise", -1)):
                turn = Warp(turn_deg=sign * degrees)
                yield Perturbation(kind, f"{degrees}°", turn, way, float(along * sign * degrees))
    for factor in (0.9, 1.1, 1.25):
        yield Perturbation("zoom", f"× {factor:g}", Warp(zoom=factor))
    for light, size in ((Light(0.6), "× 0.6"), (Light(1.4), "× 1.4"), (Light(slope=0.4), "× 0.6 to 1.4 across")):
        yield Perturbation("light", size, light)
    for sigma in (1, 2, 4):
        yield Perturbation("blur", f"{sigma} px", Blur(float(sigma)))
    for sigma in (5, 10, 20):
        yield Perturbation("noise", f"{sigma} levels", Noise(float(sigma)))
    for percent in (5, 10, 20):
        yield Perturbation("object", f"{percent} %", Disc(percent / 100))


PERTURBATIONS = tuple(_all())
"""Shifts, turns, zooms, light, blur, noise and an object in view, its diameter told in heights; three sizes each.

Turned: the whole bench under the camera, so the force in the base frame stays; turned along: as for labels in the
picture's axes.
"""


def perturbed(dataset: Dataset, disturbance: Perturbation, seed: int = 0) -> Dataset:
    """``dataset`` under ``disturbance``, the same each time; ``seed``: of its noise, or where the object lies.

    Reading it raises InputError where a view is no picture.
    """
    return replace(
        dataset,
        store=_Perturbed(dataset.store, disturbance.picture, seed, dataset.title),
        force_n=disturbance.force(dataset.force_n),
        whole=None,
        _memo={},
        _fingerprints=dataset.session_fingerprints,
    )


def in_memory(dataset: Dataset) -> Dataset:
    """``dataset`` with its observations in memory, to be read many times."""
    kept = dict(zip(dataset.rows.tolist(), dataset.observations(), strict=True))
    return replace(dataset, store=_InMemory(kept), whole=None, _memo={}, _fingerprints=dataset.session_fingerprints)


@dataclass(frozen=True, slots=True)
class _InMemory:
    observations: dict[int, Observation]

    def read(self, rows: IntArray) -> Iterator[Observation]:
        return (self.observations[row] for row in rows.tolist())


@dataclass(frozen=True, slots=True)
class _Perturbed:
    store: RowStore
    picture: ImageOperation
    seed: int
    title: str

    def read(self, rows: IntArray) -> Iterator[Observation]:
        for row, observation in zip(rows.tolist(), self.store.read(rows), strict=True):
            views = {name: self._seen(view, row) for name, view in observation.views.items()}
            yield replace(observation, views=views)

    def _seen(self, view: View, row: int) -> View:
        if isinstance(view, ShapeFeatures):
            raise InputError(f"{self.title}: holds ready-made shape numbers, and only pictures can be disturbed")
        return self.picture(view, (self.seed, row))
