"""How long one frame takes, with its picture already in memory."""

import time
from itertools import islice
from typing import Any

import numpy as np

from ..datasets import Dataset
from ..estimators import Estimator

__all__ = ["time_per_frame"]


def time_per_frame(estimator: Estimator, dataset: Dataset, frames: int = 300) -> dict[str, Any]:
    """p50, p99 and minimum in microseconds of ``update`` over up to ``frames`` frames of one session.

    Two passes over the frames; the first one warms caches and compiled code and is not counted.
    """
    name = max(dataset.sessions, key=lambda session: int(np.sum(dataset.session == session)))
    session = dataset.subset(np.flatnonzero(dataset.session == name)[:frames])
    observations = list(islice(session.observations(), frames))
    taken_ns: list[int] = []
    for counted in (False, True):
        stream = estimator.start(dataset.session_info[name])
        for observation in observations:
            start = time.perf_counter_ns()
            stream.update(observation)
            if counted:
                taken_ns.append(time.perf_counter_ns() - start)
    taken_us = np.array(taken_ns) / 1e3
    return {
        "frames": len(observations),
        "p50_us": float(np.percentile(taken_us, 50)),
        "p99_us": float(np.percentile(taken_us, 99)),
        "min_us": float(taken_us.min()),
    }
