"""Time of frame -> centreline by `tracer`, one thread, beside the time of reading the frame once from memory.

    OMP_NUM_THREADS=1 python -m bench.vision_speed [--json FILE]

Frames lie in memory, far more of them than the caches hold, and are visited in turn; the read is a sum over the
frame's 64-bit words by the same compiler. Both are timed alternately in the same run, so that a busy machine slows
both.
"""

import argparse
import json
import pathlib
import time

import numpy as np
from bench import tubes
from numba import njit

from tipforce.vision import Tracer, VisionSettings


@njit
def read_once(words: np.ndarray) -> int:
    total = np.uint64(0)
    for i in range(words.shape[0]):
        total += words[i]
    return total


def timed(size: tuple[int, int], scale: float, rounds: int, copies: int) -> dict[str, float]:
    rng = np.random.default_rng(0)
    look = tubes.Look(
        size=size, diameter=12.0 * scale, blur=scale, ring_width=8.0 * scale, length=(260 * scale, 300 * scale)
    )
    drawn = [tubes.draw(rng, look, "left").image for _ in range(8)]
    frames = [drawn[k % 8].copy() for k in range(copies)]
    tracer = Tracer(
        VisionSettings(
            base_side="left", polarity="dark", diameter_px=look.diameter, max_gap_px=12.0 * scale, threshold=128
        )
    )
    found = sum(tracer.detect(frame).found for frame in frames)
    read_once(frames[0].reshape(-1).view(np.uint64))
    see, read = [], []
    for k in range(rounds):
        # half the ring apart, so that neither finds in the cache what the other has just left there
        words = frames[(k + copies // 2) % copies].reshape(-1).view(np.uint64)
        a = time.perf_counter_ns()
        read_once(words)
        b = time.perf_counter_ns()
        tracer.detect(frames[k % copies])
        c = time.perf_counter_ns()
        read.append(b - a)
        see.append(c - b)
    at = np.percentile(see, [50, 99]) / 1e3
    base = np.percentile(read, [50, 99]) / 1e3
    return {
        "p50_us": at[0], "p99_us": at[1], "read_p50_us": base[0], "read_p99_us": base[1],
        "ratio_p50": at[0] / base[0], "found_share": found / copies,
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=2000)
    parser.add_argument("--json", type=pathlib.Path)
    given = parser.parse_args()
    results = {}
    print(f"{'frame':14} {'p50 us':>8} {'p99 us':>8} {'read p50':>9} {'read p99':>9} {'ratio':>7} {'found':>6}")
    for name, size, scale, copies in (("640x480x3", (640, 480), 1.0, 96), ("1280x1024x3", (1280, 1024), 2.0, 32)):
        r = results[name] = timed(size, scale, given.rounds, copies)
        print(
            f"{name:14} {r['p50_us']:8.1f} {r['p99_us']:8.1f} {r['read_p50_us']:9.1f} {r['read_p99_us']:9.1f}"
            f" {r['ratio_p50']:7.2f} {r['found_share']:6.2f}"
        )
    if given.json:
        given.json.write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
