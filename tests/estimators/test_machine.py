"""The machines of svr refuse arrays that do not fit together: their loop checks no index."""

from typing import Any

import numpy as np
import pytest

from tipforce.estimators._machine import Machines


def arrays(**change: Any) -> dict[str, Any]:
    good = {
        "shift": np.zeros(3), "scale": np.ones(3), "vectors": np.ones((4, 3)), "dual": np.ones(4),
        "ends": np.array([1, 4]), "intercept": np.zeros(2), "gamma": np.ones(2), "unit_n": np.ones(2),
        "weights": np.zeros((2, 3)),
    }  # fmt: skip
    return good | change


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"ends": np.array([1, 10**6])}, "ends"),
        ({"ends": np.array([-5, 4])}, "ends"),
        ({"ends": np.array([4, 1])}, "ends"),
        ({"ends": np.array([1.0, 4.0])}, "ends"),
        ({"ends": np.array([[1, 4]])}, "ends"),
        ({"ends": np.array([], np.int64)}, "weights"),
        ({"vectors": np.ones((3, 3))}, "vectors"),
        ({"vectors": np.ones((4, 2))}, "vectors"),
        ({"scale": np.ones(2)}, "scale"),
        ({"weights": np.zeros((2, 2))}, "weights"),
        ({"gamma": np.ones(1)}, "gamma"),
        ({"dual": np.array(["a", "b", "c", "d"])}, "dual"),
        ({"unit_n": np.array([1.0, np.nan])}, "unit_n"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(change: dict[str, Any], named: str) -> None:
    with pytest.raises(ValueError, match=f"^{named}: expected"):
        Machines(**arrays(**change))


def test_another_number_of_features_is_refused() -> None:
    machines = Machines(**arrays(vectors=np.asfortranarray(np.ones((4, 3)))))
    assert machines(np.zeros(3)).shape == (2,)
    with pytest.raises(ValueError, match=r"expected \(3,\) features, got \(2,\)"):
        machines(np.zeros(2))
