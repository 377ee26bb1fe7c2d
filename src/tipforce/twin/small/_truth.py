"""The hidden truth of a session, and its file."""

import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import FileFormatError
from ...types import BasePose, BoolArray, FloatArray, IntArray

__all__ = ["Truth", "read_truth", "write_truth"]

TRUTH_FILE = "truth.npz"


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """What really was, frame by frame: for evaluation only, never for an estimator.

    ``stamp_ns`` (n,): middle of the exposure, camera clock. ``force_n`` (n, 3): of the tissue on the tip, base frame.
    ``touching`` (n,). ``centreline_m`` (n, p, 2): base to tip, base frame, uniform in arc length. ``base``: the base
    frame in the picture. ``clock_offset_s``: camera time = time in the force log + this. ``values``: what was drawn,
    by name with unit. ``settings``: what it was drawn from.
    """

    session: str
    stamp_ns: IntArray
    force_n: FloatArray
    touching: BoolArray
    centreline_m: FloatArray
    base: BasePose
    metres_per_px: float
    clock_offset_s: float
    values: Mapping[str, float]
    settings: Mapping[str, Any]

    def centreline_px(self, index: int) -> FloatArray:
        """(p, 2): the true centreline in the picture of frame ``index``."""
        return self.base.to_image(self.centreline_m[index] / self.metres_per_px)


def write_truth(truth: Truth, folder: Path) -> None:
    """``truth.npz`` in ``folder``."""
    text = {"session": truth.session, "values": dict(truth.values), "settings": dict(truth.settings)}
    np.savez_compressed(
        folder / TRUTH_FILE,
        about=np.array(json.dumps(text)),
        stamp_ns=truth.stamp_ns,
        force_n=truth.force_n,
        touching=truth.touching,
        centreline_m=truth.centreline_m,
        base_origin_px=truth.base.origin_px,
        scalars=np.array([truth.base.angle_rad, truth.metres_per_px, truth.clock_offset_s]),
    )


def read_truth(session_folder: Path | str) -> Truth:
    """The truth of a session that ``tipforce simulate`` wrote into ``session_folder``.

    Raises FileFormatError where there is none.
    """
    path = Path(session_folder) / TRUTH_FILE
    if not path.is_file():
        raise FileFormatError(
            f"{path}: there is no such file; only sessions written by `tipforce simulate` have a truth"
        )
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            about = json.loads(str(arrays["about"]))
            angle, scale, offset = arrays["scalars"].tolist()
            return Truth(
                session=about["session"],
                stamp_ns=arrays["stamp_ns"],
                force_n=arrays["force_n"],
                touching=arrays["touching"],
                centreline_m=arrays["centreline_m"],
                base=BasePose(arrays["base_origin_px"], angle),
                metres_per_px=scale,
                clock_offset_s=offset,
                values=about["values"],
                settings=about["settings"],
            )
    except (KeyError, ValueError, OSError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise FileFormatError(
            f"{path}: no readable truth ({error}); delete the session's folder and run `tipforce simulate` again"
        ) from None
