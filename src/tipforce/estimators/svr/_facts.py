"""Facts of a fitted `svr`."""

from collections.abc import Mapping

from pydantic import Field

from ..shape import ShapeFacts, TargetFacts


class MachineFacts(TargetFacts):
    """Facts of one support vector machine.

    Attributes:
        c: C (thesis eq. 8).
        epsilon: epsilon (thesis eq. 10).
        sigma: sigma (thesis eq. 15).
        support_vectors: number of support vectors.
    """

    c: float
    epsilon: float
    sigma: float
    support_vectors: int


class SvrFacts(ShapeFacts, frozen=True):
    """Facts of a fitted `svr`.

    Attributes:
        targets: name of each estimated number -> its machine.
        parity_with_scikit_learn_n: largest difference of an estimate to scikit-learn's, in newtons.
    """

    targets: Mapping[str, MachineFacts] = Field(default_factory=dict)
    parity_with_scikit_learn_n: float = 0.0

    @property
    def columns(self) -> dict[str, dict[str, str]]:
        """Constants and sizes."""
        return {
            "C": {name: f"{each.c:.4g}" for name, each in self.targets.items()},
            "epsilon": {name: f"{each.epsilon:g}" for name, each in self.targets.items()},
            "sigma": {name: f"{each.sigma:g}" for name, each in self.targets.items()},
            "support vectors": {name: str(each.support_vectors) for name, each in self.targets.items()},
        }

    def target_text(self, name: str) -> str:
        """See `ShapeFacts`."""
        each = self.targets[name]
        return (
            f"C {each.c:.4g}, epsilon {each.epsilon:g}, sigma {each.sigma:g}; {each.support_vectors} support vectors; "
        )
