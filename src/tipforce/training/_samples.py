"""The arrays that a network learns from."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

__all__ = ["UNKNOWN", "Samples"]

UNKNOWN = 255
"""All over a map: a catheter never fills its picture."""

Pictures = npt.NDArray[np.uint8]
Numbers = npt.NDArray[np.float32]

_LOOKED_AT = 16


@dataclass(frozen=True, eq=False)
class Samples:
    """Labelled pictures, sample by sample.

    ``pictures`` (n, h, w[, 3]), which may be a memory map; ``inputs``: name -> (n, k) what else the network is given;
    ``force_n`` (n, t) newtons; ``session`` (n,) names; ``heat`` (n, hh, ww): where the catheter is, `UNKNOWN` all over
    where nobody knows, or None. Raises ValueError where the lengths differ.
    """

    pictures: Pictures
    force_n: Numbers
    session: npt.NDArray[np.str_]
    inputs: Mapping[str, Numbers] = field(default_factory=dict[str, Numbers])
    heat: Pictures | None = None

    def __post_init__(self) -> None:
        lengths = {"pictures": len(self.pictures), "force_n": len(self.force_n), "session": len(self.session)}
        lengths |= {name: len(values) for name, values in self.inputs.items()}
        lengths |= {} if self.heat is None else {"heat": len(self.heat)}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"samples: expected arrays of one length, got {lengths}")

    def __len__(self) -> int:
        return len(self.force_n)

    def fingerprint(self) -> str:
        """SHA-256 of all labels and inputs and of some of the pictures, spread over all."""
        digest = hashlib.sha256(repr((self.pictures.shape, sorted(self.inputs))).encode())
        for array in (self.force_n, *(self.inputs[name] for name in sorted(self.inputs))):
            digest.update(np.ascontiguousarray(array).tobytes())
        digest.update("\n".join(self.session.tolist()).encode())
        for place in np.unique(np.linspace(0, len(self) - 1, _LOOKED_AT).astype(np.int64)).tolist():
            digest.update(self.pictures[place].tobytes())
        return digest.hexdigest()
