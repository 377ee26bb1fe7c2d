"""Images of simulated datasets with their true centrelines, in memory."""

import csv
import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from tipforce.simulation import read_truth
from tipforce.types import BaseSide, FloatArray, Image
from tipforce.vision.keypoints import upright

__all__ = ["SHARES", "Sample", "load", "split"]

SHARES = {"varied": 0.6, "generalise": 0.16, "bench-2021": 0.09, "fluoro": 0.15}
"""Relative frequency of the images of each preset."""
_HELD_OUT = 20
"""One session of this number of sessions of each preset is held out, but at least four sessions."""


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """``line`` (n, 2): the true centreline in px of ``image``; sizes as the session states them, in px.

    ``small``: the image as the first network is given it, with ``small_line`` in px of it.
    """

    preset: str
    session: str
    image: Image
    line: FloatArray
    length_px: float
    diameter_px: float
    base_side: BaseSide
    small: npt.NDArray[np.uint8]
    small_line: FloatArray


def load(folder: Path) -> list[Sample]:
    """All samples of a dataset of `tipforce simulate --as dataset`."""
    facts = json.loads((folder / "dataset.json").read_text())
    with (folder / "metadata.csv").open() as file:
        rows = list(csv.DictReader(file))
    found: list[Sample] = []
    for session in dict.fromkeys(row["session"] for row in rows):
        truth = read_truth(folder / "truth" / f"{session}.truth.npz")
        own = facts["sessions"][session]
        view = (facts.get("views") or {}).get(facts["view"], {}) | own.get("views", {}).get(facts["view"], {})
        catheter = (facts.get("catheter") or {}) | own.get("catheter", {})
        scale, side = view["metres_per_px"], view["base_side"]
        length_px = (catheter["flexible_length_m"] + catheter.get("rigid_length_m", 0.0)) / scale
        at = {int(stamp): k for k, stamp in enumerate(truth.stamp_ns)}
        for row in rows:
            if row["session"] != session:
                continue
            line = truth.centreline_px[at[int(row["stamp_ns"])]]
            read = cv2.imread(str(folder / row["file_name"]), cv2.IMREAD_UNCHANGED)
            if read is None:
                raise SystemExit(f"{folder / row['file_name']}: cannot be read as an image; simulate the dataset again")
            image = read if read.ndim == 2 else np.ascontiguousarray(read[:, :, ::-1])
            small = upright(image, side, length_px)
            found.append(
                Sample(
                    facts["preset"].split()[0], session, image, line, length_px, catheter["diameter_m"] / scale, side,
                    small.image, small.from_original(line),
                )
            )  # fmt: skip
    return found


def split(samples: list[Sample]) -> tuple[list[Sample], list[Sample]]:
    """Returns the training samples, and the samples of held-out sessions."""
    held: set[str] = set()
    for preset in dict.fromkeys(sample.preset for sample in samples):
        names = sorted({sample.session for sample in samples if sample.preset == preset})
        held.update(names[-max(4, len(names) // _HELD_OUT) :])
    return [s for s in samples if s.session not in held], [s for s in samples if s.session in held]
