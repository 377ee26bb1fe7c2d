"""Contact sheet of a preset's sessions: one frame of each, as recorded, of all views.

python docs/figures/make_simulation.py RUNS docs/figures/simulation.jpg [--frame 200] [--columns 4]
"""

import argparse
from pathlib import Path

import cv2
import numpy as np

from tipforce.io import RecordingReader

MOST_BYTES = 140_000


def main() -> None:
    """Read, tile, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path)
    parser.add_argument("image", type=Path)
    parser.add_argument("--frame", type=int, default=200)
    parser.add_argument("--columns", type=int, default=4)
    options = parser.parse_args()
    tiles = [tile(path, options.frame) for path in sorted(options.runs.glob("*.mcap"))]
    wide = options.columns
    rows = [np.hstack(tiles[k : k + wide]) for k in range(0, len(tiles) - wide + 1, wide)]
    sheet = cv2.cvtColor(np.vstack(rows), cv2.COLOR_RGB2BGR)
    for quality in range(85, 20, -5):  # the largest file that stays small
        data = cv2.imencode(".jpg", sheet, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        if data.size < MOST_BYTES:
            break
    options.image.write_bytes(data.tobytes())


def tile(path: Path, index: int) -> np.ndarray:
    """All views of one frame side by side, each 240 rows high."""
    with RecordingReader(path) as reader:
        stamp = reader.stamps(reader.views[0])[index]
        places = [int(np.argmin(np.abs(reader.stamps(view) - stamp))) for view in reader.views]
        shown = [reader.frame_at(place, view).image for place, view in zip(places, reader.views, strict=True)]
    scaled = [
        cv2.resize(each, (240 * each.shape[1] // each.shape[0], 240), interpolation=cv2.INTER_AREA) for each in shown
    ]
    return np.hstack([each if each.ndim == 3 else cv2.cvtColor(each, cv2.COLOR_GRAY2RGB) for each in scaled])


if __name__ == "__main__":
    main()
