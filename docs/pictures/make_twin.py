"""Contact sheet of a preset's sessions: one frame of each, as recorded.

python docs/pictures/make_twin.py RUNS docs/pictures/twin.jpg [--frame 200] [--columns 4]
"""

import argparse
from pathlib import Path

import cv2
import numpy as np

from tipforce.recording import RecordingReader


def main() -> None:
    """Read, tile, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("--frame", type=int, default=200)
    parser.add_argument("--columns", type=int, default=4)
    options = parser.parse_args()
    tiles = []
    for path in sorted(options.runs.glob("*.mcap")):
        with RecordingReader(path) as reader:
            tiles.append(cv2.resize(reader.frame_at(options.frame).image, (320, 240), interpolation=cv2.INTER_AREA))
    wide = options.columns
    rows = [np.hstack(tiles[k : k + wide]) for k in range(0, len(tiles) - wide + 1, wide)]
    cv2.imwrite(str(options.picture), cv2.cvtColor(np.vstack(rows), cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 82])


if __name__ == "__main__":
    main()
