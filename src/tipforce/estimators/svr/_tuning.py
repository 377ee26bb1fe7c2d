"""Chooses C, epsilon and sigma by cross-validation on the training part alone."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...types import FloatArray, IntArray
from ..shape import Fold
from ._machine import Constants, gram, largest, squared_distances
from ._settings import SvrSettings

MAX_ERROR_RISE = 1.05
"""Larger values of C are skipped after the error has risen by this factor over the smallest one at the same sigma."""

Scaling = tuple[FloatArray, FloatArray]
Report = Callable[[str, float], None]


def scaling_of(raw: FloatArray, how: str) -> Scaling:
    """Returns the scaling of features: scaled = (raw - shift) * scale. A constant zero stays zero.

    Args:
        raw: (n, k) features.
        how: "max": the largest absolute value becomes 1; otherwise mean 0 and standard deviation 1.

    Returns:
        Shift (k,) and scale (k,).

    >>> shift, scale = scaling_of(np.array([[0.0, -4.0], [0.0, 2.0]]), "max")
    >>> shift.tolist(), scale.tolist()
    ([0.0, 0.0], [1.0, 0.25])
    """
    if how == "max":
        return np.zeros(raw.shape[1]), 1.0 / largest(raw)
    spread = np.std(raw, axis=0)
    # a feature that never changed in training has no information: 0 keeps it without effect later
    usable = spread > 1e-9 * largest(raw)
    return np.mean(raw, axis=0), np.where(usable, 1.0 / np.where(usable, spread, 1.0), 0.0)


@dataclass(frozen=True)
class _Part:
    """One fold with all numbers that no constant changes: distances, products, labels in shares of the largest."""

    train: IntArray
    test: IntArray
    near: FloatArray
    far: FloatArray
    near_products: FloatArray | None
    far_products: FloatArray | None


class _Search:
    def __init__(self, raw: FloatArray, folds: Sequence[Fold], settings: SvrSettings, linear: FloatArray) -> None:
        self.parts: list[_Part] = []
        for train, test in folds:
            shift, scale = scaling_of(raw[train], settings.scaling)
            a, b = (raw[train] - shift) * scale, (raw[test] - shift) * scale
            products = ((a * linear) @ a.T, (b * linear) @ a.T) if linear.any() else (None, None)
            self.parts.append(_Part(train, test, squared_distances(a, a), squared_distances(b, a), *products))
        self.count = len(raw)

    def predictions(self, learn_n: FloatArray, constants: Constants) -> FloatArray:
        """Returns (n,) newtons, each sample from a machine without its fold; NaN for samples that no fold tests."""
        from sklearn.svm import SVR  # a slow import, which estimates do not need

        out = np.full(self.count, np.nan)
        for part in self.parts:
            unit = float(largest(learn_n[part.train][:, None])[0])
            machine: Any = SVR(kernel="precomputed", C=constants.c, epsilon=constants.epsilon, cache_size=500)
            machine.fit(gram(part.near, part.near_products, constants.sigma), learn_n[part.train] / unit)
            out[part.test] = machine.predict(gram(part.far, part.far_products, constants.sigma)) * unit
        return out


def choose(
    raw: FloatArray,
    learn_n: FloatArray,
    truth_n: FloatArray,
    folds: Sequence[Fold],
    settings: SvrSettings,
    linear: FloatArray,
    report: Report,
) -> tuple[list[Constants], FloatArray]:
    """Chooses the constants of each target by the least mean squared error over the folds.

    C and sigma are chosen together at a middle epsilon, then epsilon at those. For each sigma, from the widest on, C
    grows until the error has risen by `MAX_ERROR_RISE` over the smallest at that sigma: larger ones take longest and
    are worse. Ties go to the smaller C and the larger sigma.

    Args:
        raw: (n, k) features.
        learn_n: (n, t) forces to learn from, in newtons.
        truth_n: (n, t) forces that errors are measured on, in newtons.
        folds: folds of the cross-validation.
        settings: the values to choose from.
        linear: (k,) weight of each feature's products in the kernel.
        report: called with a description of the current work and its share.

    Returns:
        The constants of each target, and with these the estimates (n, t) of the samples that each fold holds out.
    """
    search = _Search(raw, folds, settings, linear)
    middle = settings.epsilon[len(settings.epsilon) // 2]
    others = [epsilon for epsilon in settings.epsilon if epsilon != middle]
    steps = (len(settings.sigma) * len(settings.c) + len(others)) * learn_n.shape[1]
    done, chosen = 0, list[Constants]()
    for t in range(learn_n.shape[1]):

        def error_of(constants: Constants, t: int = t) -> float:
            found = search.predictions(learn_n[:, t], constants)
            return float(np.sqrt(np.nanmean((found - truth_n[:, t]) ** 2)))

        best, least = Constants(min(settings.c), middle, max(settings.sigma)), np.inf
        for sigma in sorted(settings.sigma, reverse=True):
            lowest, error = np.inf, 0.0
            for c in sorted(settings.c):
                done += 1
                if error > MAX_ERROR_RISE * lowest:
                    continue
                candidate = Constants(c, middle, sigma)
                error = error_of(candidate)
                lowest = min(lowest, error)
                if error < least * (1 - 1e-6):
                    best, least = candidate, error
                report("choosing C, epsilon and sigma", done / steps)
        for epsilon in others:
            candidate = Constants(best.c, epsilon, best.sigma)
            error = error_of(candidate)
            if error < least * (1 - 1e-6):
                best, least = candidate, error
            done += 1
            report("choosing C, epsilon and sigma", done / steps)
        chosen.append(best)
    held_out_n = [search.predictions(learn_n[:, t], each) for t, each in enumerate(chosen)]
    return chosen, np.column_stack(held_out_n)
