"""The companion file of a simulated session when it is damaged."""

from pathlib import Path

import numpy as np
import pytest

from tipforce.errors import FileFormatError
from tipforce.simulation import read_truth


def test_a_truth_with_a_flipped_bit_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.truth.npz"
    np.savez_compressed(
        path, allow_pickle=False, about=np.array("{}"), force_n=np.random.default_rng(0).random((64, 3))
    )
    raw = bytearray(path.read_bytes())
    raw[len(raw) // 2] ^= 1
    path.write_bytes(raw)
    with pytest.raises(FileFormatError, match=r"a\.truth\.npz: no readable arrays .*run `tipforce simulate` again"):
        read_truth(path)
