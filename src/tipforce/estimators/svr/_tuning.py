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

_BETTER = 1 - 1e-6
"""An error below the least one by less than this factor is a tie."""

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
    """One fold: its samples, and the matrices of the kernel that C, epsilon and sigma do not change.

    ``train_`` and ``test_``: squared distances and weighted products (or None) of the training and the test samples to
    the training samples.
    """

    train: IntArray
    test: IntArray
    train_distances: FloatArray
    test_distances: FloatArray
    train_products: FloatArray | None
    test_products: FloatArray | None


class _Search:
    """Estimates of held-out samples, for any constants."""

    def __init__(self, raw: FloatArray, folds: Sequence[Fold], settings: SvrSettings, linear: FloatArray) -> None:
        """Prepares the folds; see `choose` for the arguments. Each fold is scaled by its training samples alone."""
        self.parts: list[_Part] = []
        for train, test in folds:
            shift, scale = scaling_of(raw[train], settings.scaling)
            x_train, x_test = (raw[train] - shift) * scale, (raw[test] - shift) * scale
            products = (None, None)
            if linear.any():
                products = (x_train * linear) @ x_train.T, (x_test * linear) @ x_train.T
            distances = squared_distances(x_train, x_train), squared_distances(x_test, x_train)
            self.parts.append(_Part(train, test, *distances, *products))
        self.count = len(raw)

    def predictions(self, learn_n: FloatArray, constants: Constants) -> FloatArray:
        """Returns (n,) newtons, each sample from a machine without its fold; NaN for samples that no fold tests."""
        from sklearn.svm import SVR  # a slow import, which estimates do not need

        out = np.full(self.count, np.nan)
        for part in self.parts:
            unit = float(largest(learn_n[part.train][:, None])[0])
            machine: Any = SVR(kernel="precomputed", C=constants.c, epsilon=constants.epsilon, cache_size=500)
            kernel = gram(part.train_distances, part.train_products, constants.sigma)
            machine.fit(kernel, learn_n[part.train] / unit)
            out[part.test] = machine.predict(gram(part.test_distances, part.test_products, constants.sigma)) * unit
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

        def rms_error_n(constants: Constants, t: int = t) -> float:
            error_n = search.predictions(learn_n[:, t], constants) - truth_n[:, t]
            return float(np.sqrt(np.nanmean(error_n**2)))

        best, least_n = Constants(min(settings.c), middle, max(settings.sigma)), np.inf
        for sigma in sorted(settings.sigma, reverse=True):
            least_at_sigma_n, error_n = np.inf, 0.0
            for c in sorted(settings.c):
                done += 1
                if error_n > MAX_ERROR_RISE * least_at_sigma_n:
                    continue
                candidate = Constants(c, middle, sigma)
                error_n = rms_error_n(candidate)
                least_at_sigma_n = min(least_at_sigma_n, error_n)
                if error_n < least_n * _BETTER:
                    best, least_n = candidate, error_n
                report("choosing C, epsilon and sigma", done / steps)
        for epsilon in others:
            candidate = Constants(best.c, epsilon, best.sigma)
            error_n = rms_error_n(candidate)
            if error_n < least_n * _BETTER:
                best, least_n = candidate, error_n
            done += 1
            report("choosing C, epsilon and sigma", done / steps)
        chosen.append(best)
    held_out_n = [search.predictions(learn_n[:, t], constants) for t, constants in enumerate(chosen)]
    return chosen, np.column_stack(held_out_n)
