"""Time of `rod-3d` from the images of two views to the force, stage by stage.

    python -m bench.studies.space_time RECORDING [--pairs 150]

Each pair goes through the method as in `tipforce live`: both views are detected at the same time, on a thread each.
Beside a page or on fewer cores it takes longer. Times of detection and of its two networks are those of one view.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tipforce.alignment import observations
from tipforce.estimators import create
from tipforce.estimators._session_detection import SessionDetection
from tipforce.estimators.space._filter import SpaceFilter
from tipforce.io import images_beforehand, open_source
from tipforce.types import views_of
from tipforce.vision.locator import _locate, _reading

WARM_UP = 5
"""First pairs, which compile and load, and do not count."""
TARGET_MS = 1000.0 / 15.0
"""Time of a pair at 15 pairs a second."""


def timed(owner: Any, name: str, times_ms: list[float]) -> None:
    """Replaces ``owner.name`` by the same function that appends its milliseconds to ``times_ms``."""
    function: Callable[..., Any] = getattr(owner, name)

    def measured(*given: Any, **named: Any) -> Any:
        before = time.perf_counter()
        try:
            return function(*given, **named)
        finally:
            times_ms.append(1e3 * (time.perf_counter() - before))

    setattr(owner, name, measured)


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("--pairs", type=int, default=150)
    options = parser.parse_args()
    stages: dict[str, list[float]] = {
        name: [] for name in ("first network", "second network", "detection of a view", "rod in space", "pair")
    }
    with open_source(options.recording) as source:
        estimator = create("rod-3d").for_views(views_of(source))
        images = {view: images_beforehand(source, view) for view in estimator.views}
        seen = list(observations(source, estimator.views, apart=False))[: options.pairs]
        stream = estimator.start_on(source.session_info, images)
    for observation in seen[:WARM_UP]:
        stream.update(observation)
    timed(_locate, "rough_points", stages["first network"])
    timed(_reading, "refine", stages["second network"])
    timed(SessionDetection, "read", stages["detection of a view"])
    timed(SpaceFilter, "step", stages["rod in space"])
    timed(stream, "update", stages["pair"])
    valid = sum(stream.update(observation).valid for observation in seen[WARM_UP:])
    print(f"{len(seen) - WARM_UP} pairs, {valid} valid; at 15 pairs a second a pair has {TARGET_MS:.0f} ms")
    for name, times_ms in stages.items():
        middle, high = np.percentile(times_ms, (50.0, 95.0))
        print(f"{name:>20}: {len(times_ms)} times, p50 {middle:.1f} ms, p95 {high:.1f} ms")


if __name__ == "__main__":
    main()
