import math
import socket
import time
from collections.abc import Callable

import numpy as np
import pytest

from tipforce.clinical import ContactMonitor
from tipforce.live import LiveHealth, LiveUpdate
from tipforce.types import (
    BasePose,
    CentrelinePx,
    DetectedShape,
    ForceEstimate,
    SessionInfo,
    Status,
    ViewInfo,
)

NEVER_AGAIN = 0.25
"""Magnitude of the valid updates: it may not appear in an invalid one."""
INFO = SessionInfo("bench", views={"camera": ViewInfo(metres_per_px=2e-4)})


def estimate_of(number: int, valid: bool) -> ForceEstimate:
    stamp_ns = 1_000_000_000 + number * 20_000_000
    # from (100, 100) to the right, then up: the last stretch goes up
    bent = np.array([[100.0 + k, 100.0] for k in range(50)] + [[150.0, 100.0 - k] for k in range(51)])
    shape = DetectedShape(Status.VALID, "", CentrelinePx(bent), BasePose(np.array([100.0, 100.0]), 0.0), 8.0, 1.0)
    if not valid:
        return ForceEstimate.invalid(stamp_ns, Status.STALE, "the camera is late: no image for 200 ms", shape)
    return ForceEstimate(
        stamp_ns=stamp_ns,
        force_n=np.array([-0.15, 0.2, math.nan]),
        known=np.array([True, True, False]),
        covariance_n2=np.full((3, 3), math.nan),
        interval_n=np.array([[-0.18, -0.12], [0.17, 0.23], [math.nan, math.nan]]),
        magnitude_n=NEVER_AGAIN,
        magnitude_interval_n=np.array([0.22, 0.28]),
        contact=0.98,
        shape=shape,
    )


@pytest.fixture
def update() -> Callable[..., LiveUpdate]:
    """Update ``number``, taken 12 ms before it was published now."""
    monitor = ContactMonitor()

    def make(number: int = 0, *, valid: bool = True) -> LiveUpdate:
        estimate, now_ns = estimate_of(number, valid), time.monotonic_ns()
        image = np.full((48, 64), 200, np.uint8)
        frames = {"camera": image} if valid else {}
        health = LiveHealth(frames_per_s=50.0, frames_in=number + 1, camera="running" if valid else "late")
        return LiveUpdate(number, estimate, monitor.update(estimate), frames, now_ns - 12_000_000, now_ns, health)

    return make


@pytest.fixture
def info() -> SessionInfo:
    return INFO


@pytest.fixture
def free_port() -> int:
    """A port of 127.0.0.1 that nobody listens on."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]
