"""Measures the speed of writing and reading recordings: a minute of 24 frames/s (640x480) and 1 kHz force.

python -m bench.studies.recording_speed [--lossless] [--minutes 1]
"""

import argparse
import resource
import tempfile
import time
from pathlib import Path

import numpy as np

from tipforce.alignment import labels
from tipforce.io import RecordingReader, RecordingWriter
from tipforce.types import Actuation, Frame, SensorInfo, SessionInfo, Wrench


def main() -> None:
    """Reads the command line, and prints the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lossless", action="store_true")
    parser.add_argument("--minutes", type=float, default=1.0)
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    images = [210 + rng.integers(-12, 12, (480, 640)).astype(np.uint8) for _ in range(8)]
    count = round(60_000 * options.minutes)
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "run.mcap"
        start, frames = time.perf_counter(), 0
        with RecordingWriter(path, SessionInfo(), lossless=options.lossless) as writer:
            writer.state(SensorInfo(30.0, "tip-on-tissue"))
            writer.write(Actuation(0, {"knob_deg": 10.0}))
            for k in range(count):
                writer.write(Wrench(k * 1_000_000, np.array([0.1, 1e-3 * (k % 200), 0.0]), np.zeros(3), "sensor"))
                if k * 24 >= frames * 1000:
                    writer.write(Frame(k * 1_000_000, images[frames % 8]))
                    frames += 1
        took = time.perf_counter() - start
        size = path.stat().st_size / 1e6
        print(f"write      {took:7.2f} s   {60 * options.minutes / took:6.1f} x real time, {size:.0f} MB")
        with RecordingReader(path) as reader:
            for part, call in (
                ("info", lambda: reader.info),
                ("wrenches", reader.wrenches),
                ("labels", lambda: labels(reader)),
                ("all events", lambda: sum(1 for _ in reader)),
                ("200 frames", lambda: [reader.frame_at(int(k)) for k in rng.integers(0, frames, 200)]),
            ):
                start = time.perf_counter()
                call()
                print(f"{part:<10} {1e3 * (time.perf_counter() - start):7.1f} ms")
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")


if __name__ == "__main__":
    main()
