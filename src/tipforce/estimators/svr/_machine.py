"""The fitted machines: trained with scikit-learn (libsvm), evaluated without it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt
from numba import njit
from pydantic import Field

from ...types import FloatArray, IntArray
from .._values import stored_array

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


@dataclass(frozen=True, slots=True)
class Constants:
    """Constants that are chosen by cross-validation.

    Attributes:
        c: C (thesis eq. 8).
        epsilon: epsilon (thesis eq. 10).
        sigma: sigma (thesis eq. 15).
    """

    c: Positive
    epsilon: Positive
    sigma: Positive


@dataclass(frozen=True, eq=False)
class Machines:
    """One support vector machine for each target; they map raw features (k,) to newtons (t,).

    Attributes:
        shift: (k,) offset: scaled feature = (raw - shift) * scale.
        scale: (k,) scale.
        vectors: (m, k) support vectors of all targets, target after target.
        dual: (m,) dual coefficients.
        ends: (t,) index behind the last vector of each target.
        intercept: (t,) intercepts.
        gamma: (t,) 1 / sigma^2 of the kernel.
        unit_n: (t,) newtons of one unit.
        weights: (t, k) linear part of the kernel, already summed.
    """

    shift: FloatArray
    scale: FloatArray
    vectors: FloatArray
    dual: FloatArray
    ends: IntArray
    intercept: FloatArray
    gamma: FloatArray
    unit_n: FloatArray
    weights: FloatArray
    parity_n: float = 0.0
    """Largest deviation from scikit-learn on the training samples, in newtons."""

    def __call__(self, raw: FloatArray) -> FloatArray:
        """Returns (t,) newtons for the raw features (k,)."""
        out = np.empty(len(self.ends))
        evaluate(
            raw, self.shift, self.scale, self.vectors, self.dual, self.ends, self.intercept, self.gamma, self.unit_n,
            self.weights, out,
        )  # fmt: skip
        return out

    def many(self, raw: FloatArray) -> FloatArray:
        """Returns (n, t) newtons for the raw features (n, k)."""
        out = np.empty((len(raw), len(self.ends)))
        for row in range(len(raw)):
            out[row] = self(raw[row])
        return out

    def arrays(self) -> dict[str, Any]:
        """Returns all arrays by name, for the model store."""
        names = ("shift", "scale", "vectors", "dual", "ends", "intercept", "gamma", "unit_n", "weights")
        return {name: getattr(self, name) for name in names}

    @classmethod
    def of(cls, arrays: Mapping[str, npt.NDArray[Any]], features: int, targets: int, parity_n: float) -> "Machines":
        """Makes machines from `arrays`.

        `evaluate` does not check these arrays: it would read beyond the ends of shorter ones.

        Args:
            arrays: the arrays by name.
            features: number k of features.
            targets: number t of forces.
            parity_n: largest deviation from scikit-learn in newtons.

        Raises:
            KeyError: an array is missing.
            ValueError: an array has a wrong shape or value.
        """
        vectors = stored_array(arrays, "vectors", (None, features))
        ends = stored_array(arrays, "ends", (targets,), low=0, high=len(vectors)).astype(np.int64)
        if (np.diff(ends) < 0).any() or ends[-1] != len(vectors):
            raise ValueError(f"ends {ends.tolist()} do not part {len(vectors)} support vectors")
        return cls(
            shift=stored_array(arrays, "shift", (features,)),
            scale=stored_array(arrays, "scale", (features,), low=0),
            vectors=vectors,
            dual=stored_array(arrays, "dual", (len(vectors),)),
            ends=ends,
            intercept=stored_array(arrays, "intercept", (targets,)),
            gamma=stored_array(arrays, "gamma", (targets,), low=0),
            unit_n=stored_array(arrays, "unit_n", (targets,), low=0),
            weights=stored_array(arrays, "weights", (targets, features)),
            parity_n=parity_n,
        )


@njit(cache=True, nogil=True, fastmath=True)
def evaluate(
    raw: FloatArray, shift: FloatArray, scale: FloatArray, vectors: FloatArray, dual: FloatArray, ends: IntArray,
    intercept: FloatArray, gamma: FloatArray, unit_n: FloatArray, weights: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Computes the forces of one frame: for each target, kernels of the support vectors (thesis eq. 13 and 15).

    Args:
        raw: (k,) features.
        shift: (k,) offset of the features.
        scale: (k,) scale of the features.
        vectors: (m, k) scaled support vectors of all targets, target after target.
        dual: (m,) dual coefficients.
        ends: (t,) index behind the last vector of each target.
        intercept: (t,) intercepts.
        gamma: (t,) 1 / sigma^2 of the kernel.
        unit_n: (t,) newtons of one unit.
        weights: (t, k) weights of the linear part of the kernel.
        out: (t,) receives the forces in newtons.
    """
    k = raw.shape[0]
    x = np.empty(k)
    for j in range(k):
        x[j] = (raw[j] - shift[j]) * scale[j]
    start = 0
    for t in range(ends.shape[0]):
        total = intercept[t]
        for j in range(k):
            total += weights[t, j] * x[j]
        for i in range(start, ends[t]):
            square = 0.0
            for j in range(k):
                difference = x[j] - vectors[i, j]
                square += difference * difference
            total += dual[i] * math.exp(-gamma[t] * square)
        start = ends[t]
        out[t] = total * unit_n[t]


def squared_distances(a: FloatArray, b: FloatArray) -> FloatArray:
    """Returns the squared distances (n, m) of all pairs of rows.

    Args:
        a: (n, k) scaled features.
        b: (m, k) scaled features.
    """
    square = np.sum(a * a, axis=1)[:, None] + np.sum(b * b, axis=1)[None] - 2.0 * (a @ b.T)
    return np.maximum(square, 0.0)


def gram(distances: FloatArray, products: FloatArray | None, sigma: float) -> FloatArray:
    """Returns the kernel matrix (n, m): thesis eq. (15), plus the linear part where there is one.

    Args:
        distances: (n, m) squared distances.
        products: (n, m) weighted products of the features; None: no linear part.
        sigma: width of the kernel.
    """
    kernel = np.exp(distances * (-1.0 / sigma**2))
    return kernel if products is None else kernel + products


def fit_machines(
    raw: FloatArray,
    targets_n: FloatArray,
    constants: Sequence[Constants],
    shift: FloatArray,
    scale: FloatArray,
    linear: FloatArray,
) -> Machines:
    """Trains one machine for each force.

    Args:
        raw: (n, k) features.
        targets_n: (n, t) forces, N.
        constants: the constants of each target.
        shift: (k,) offset of the features.
        scale: (k,) scale of the features.
        linear: (k,) weight of each scaled feature's products in the kernel; zeros for the kernel of the thesis.

    Returns:
        The machines, with their largest deviation from scikit-learn.
    """
    from sklearn.svm import SVR  # a slow import, which estimates do not need

    x = np.ascontiguousarray((raw - shift) * scale)
    unit = largest(targets_n)
    vectors, dual, intercept, weights, predicted = [], [], [], [], np.empty_like(targets_n)
    for t, chosen in enumerate(constants):
        y = targets_n[:, t] / unit[t]
        common: dict[str, Any] = {"C": chosen.c, "epsilon": chosen.epsilon, "cache_size": 500}
        if linear.any():
            kernel = gram(squared_distances(x, x), (x * linear) @ x.T, chosen.sigma)
            machine = SVR(kernel="precomputed", **common).fit(kernel, y)
            predicted[:, t] = machine.predict(kernel)
        else:
            # scikit-learn's stubs know gamma as a word only
            machine = SVR(kernel="rbf", gamma=1.0 / chosen.sigma**2, **common).fit(x, y)  # type: ignore[arg-type]
            predicted[:, t] = machine.predict(x)
        support = np.asarray(machine.support_)
        vectors.append(x[support])
        dual.append(np.asarray(machine.dual_coef_)[0])
        intercept.append(float(np.asarray(machine.intercept_)[0]))
        weights.append((dual[-1] @ x[support]) * linear)  # the linear part of the kernel, summed over the vectors
    machines = Machines(
        shift=shift,
        scale=scale,
        vectors=np.ascontiguousarray(np.concatenate(vectors)),
        dual=np.concatenate(dual),
        ends=np.cumsum([len(part) for part in dual]),
        intercept=np.array(intercept),
        gamma=np.array([1.0 / chosen.sigma**2 for chosen in constants]),
        unit_n=unit,
        weights=np.ascontiguousarray(weights),
    )
    parity_n = float(np.max(np.abs(machines.many(raw) - predicted * unit)))
    return Machines(**machines.arrays(), parity_n=parity_n)


def largest(values: FloatArray) -> FloatArray:
    """Returns (k,) the largest absolute value of each column of ``values`` (n, k); 1 for a column of zeros."""
    size = np.max(np.abs(values), axis=0)
    return np.where(size > 0, size, 1.0)
