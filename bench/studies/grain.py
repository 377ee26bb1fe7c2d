"""Measures the correlation of image noise between neighbouring pixels and between colours, in the flattest parts.

    python -m bench.studies.grain IMAGE_OR_RECORDING [...]

A camera demosaics, sharpens and cleans, which draws pixels together; images of a bench in software should do so too.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np

from tipforce.io import RecordingReader

TILE, TILES = 32, 40
FLAT_PX, GROUND_PX = 3.0, 4.0
FRAME = 10


def grain(image: np.ndarray) -> dict[str, float]:
    """Returns sigma of green in grey levels, its correlations, and that with red, for an RGB ``image`` (h, w, 3)."""
    green, red = image[..., 1].astype(np.float64), image[..., 0].astype(np.float64)
    noise, other = (one - cv2.GaussianBlur(one, (0, 0), GROUND_PX) for one in (green, red))
    smooth = cv2.GaussianBlur(green, (0, 0), FLAT_PX)
    corners = [(v, u) for v in range(0, len(green) - TILE, TILE) for u in range(0, green.shape[1] - TILE, TILE)]
    flattest = sorted(corners, key=lambda at: smooth[at[0] : at[0] + TILE, at[1] : at[1] + TILE].std())[:TILES]
    rows = []
    for v, u in flattest:
        a, b = (one[v : v + TILE, u : u + TILE] for one in (noise, other))
        square = (a * a).mean()
        across, further, down = (a[:, 1:] * a[:, :-1]).mean(), (a[:, 2:] * a[:, :-2]).mean(), (a[1:] * a[:-1]).mean()
        colours = (a * b).mean() / np.sqrt(square * (b * b).mean())
        rows.append((np.sqrt(square), across / square, further / square, down / square, colours))
    names = ("sigma", "across", "two across", "down", "green and red")
    return dict(zip(names, np.median(rows, axis=0).tolist(), strict=True))


def load_image(path: Path) -> np.ndarray:
    """Returns an RGB image of a file or of a recording."""
    if path.suffix == ".mcap":
        with RecordingReader(path) as reader:
            return reader.frame_at(FRAME).image
    return cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)


def main() -> None:
    """Reads the command line, and prints a line for each image."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("paths", type=Path, nargs="+")
    for path in parser.parse_args().paths:
        print(path.name, ", ".join(f"{name} {value:.2f}" for name, value in grain(load_image(path)).items()))


if __name__ == "__main__":
    main()
