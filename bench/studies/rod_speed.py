"""Processor time of `rod` and `rod-track` a frame after the centreline is there: recorded sessions, one thread.

    OMP_NUM_THREADS=1 python -m bench.studies.rod_speed RUNS [--sessions N]

The time of the detection in the same frame is measured separately and printed beside it.
"""

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
from bench.parts import one_thread

from tipforce.datasets import calibration_images, open_recordings
from tipforce.estimators import create
from tipforce.types import FloatArray, Observation

WARM_UP = 100
"""First frames of a session that do not count: kernels compile and caches fill."""


class Timed:
    """A stream's detection, which remembers how long its last reading took."""

    def __init__(self, detection: Any) -> None:
        self._detection = detection
        self.seconds = 0.0

    @property
    def shape(self) -> Any:
        """Shape that was detected last."""
        return self._detection.shape

    def read(self, observation: Observation) -> Any:
        """As the detection's."""
        begun = time.thread_time()
        found = self._detection.read(observation)
        self.seconds = time.thread_time() - begun
        return found


def times_of(method: str, recording: Path) -> FloatArray:
    """(n, 2) seconds of each frame with an answer: detection, and all that follows."""
    data = open_recordings([recording], recording.stem)
    observations = list(data.observations())
    name = data.sessions[0]
    stream: Any = create(method).start(data.session_info[name], calibration_images(data, name, "camera"))
    stream._detection = detection = Timed(stream._detection)
    rows: list[tuple[float, float]] = []
    for number, observation in enumerate(observations):
        begun = time.thread_time()
        found = stream.update(observation)
        whole = time.thread_time() - begun
        if number >= WARM_UP and found.valid:
            rows.append((detection.seconds, whole - detection.seconds))
    return np.array(rows).reshape(-1, 2)


def main() -> None:
    """Time, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path)
    parser.add_argument("--sessions", type=int, default=4)
    chosen = parser.parse_args()
    one_thread()
    recordings = sorted(chosen.runs.glob("session_*.mcap"))[: chosen.sessions]
    for method in ("rod", "rod-track"):
        found = 1e6 * np.concatenate([times_of(method, recording) for recording in recordings])
        middle, late = np.percentile(found, [50, 99], axis=0)
        print(
            f"{method}: {len(found)} frames; after the centreline p50 {middle[1]:.0f} us, p99 {late[1]:.0f}, "
            f"mean {found[:, 1].mean():.0f}; detection p50 {middle[0]:.0f} us"
        )


if __name__ == "__main__":
    main()
