"""Faults injected into a live run: time until the output is invalid, and until it is valid again.

    OMP_NUM_THREADS=1 python -m bench.studies.live_faults pretrained/compact [--rounds N] [--json FILE]

Images of the simulated bench (640x480, 60 Hz) come from memory. Each fault lasts two seconds, then the camera works
again. Until invalid: from mid-exposure of the last good image to the first output without a force, which may be at
most 200 ms (the rule) and the time in which the machine wakes a thread. Until valid: from mid-exposure of the first
good image after the fault to the first force.
"""

import argparse
import json
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from bench.machine import machine
from bench.studies.live_engine import RATE_HZ, write_input

from tipforce.estimators import load_model
from tipforce.io import open_source
from tipforce.live import Engine, LiveSettings, LiveUpdate
from tipforce.types import Frame, SystemClock

WARM_S, FAULT_S, WELL_S = 12.0, 2.0, 3.0
PERIOD_NS = round(1e9 / RATE_HZ)
KEPT = 360


class Unplugged(OSError):
    """The error that a driver raises."""


class FaultyCamera:
    """Images from memory; ``fault`` changes them while it is set. Notes the stamps of good ones."""

    def __init__(self, images, info) -> None:
        self.images, self.session_info, self.clock = images, info, SystemClock()
        self.fault: Callable[[np.ndarray], np.ndarray | None] | None = None
        self.good_ns: list[int] = []
        self.number = 0

    def __iter__(self) -> Iterator[Frame]:
        next_ns = self.clock.now_ns()
        while True:
            # a camera that nobody reads in time drops images
            next_ns = max(next_ns + PERIOD_NS, self.clock.now_ns() - PERIOD_NS)
            self.clock.sleep_until_ns(next_ns)
            image, self.number = self.images[self.number % len(self.images)], self.number + 1
            fault = self.fault
            if fault is not None:
                image = fault(image)
            else:
                self.good_ns = [*self.good_ns[-1000:], next_ns]
            if image is not None:
                yield Frame(next_ns, image)

    def __enter__(self) -> "FaultyCamera":
        return self

    def __exit__(self, *_: Any) -> None:
        pass


class Hanging:
    """A model whose stream can be made to hang."""

    def __init__(self, model: str) -> None:
        self._estimator, self.until = load_model(model), 0.0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._estimator, name)

    def start(self, info, images=()):
        self._stream = self._estimator.start(info, images)
        return self

    def update(self, observation):
        while time.monotonic() < self.until:
            time.sleep(0.01)
        return self._stream.update(observation)


class Notes:
    name, keeps_all = "notes", True

    def __init__(self) -> None:
        self.updates: list[tuple[bool, int, int, str]] = []

    def start(self, info, model) -> None:
        pass

    def put(self, update: LiveUpdate) -> None:
        self.updates.append((update.estimate.valid, update.captured_ns, update.published_ns, update.estimate.detail))

    def close(self) -> None:
        pass


def frozen() -> Callable[[np.ndarray], np.ndarray]:
    kept: list[np.ndarray] = []

    def same(image):
        kept[:] = kept or [image]
        return kept[0]

    return same


def unplugged(_):
    raise Unplugged("no such device")


FAULTS: dict[str, Callable[[], Callable[[np.ndarray], np.ndarray | None]]] = {
    "silent": lambda: lambda _: None,
    "unplugged (the driver raises)": lambda: unplugged,
    "frozen": frozen,
    "black": lambda: np.zeros_like,
    "wrong size": lambda: lambda image: np.ascontiguousarray(image[:240, :320]),
}
HANGING = "method hangs"


def one(fault: str, camera: FaultyCamera, method: Hanging, notes: Notes) -> dict[str, Any]:
    """One fault; milliseconds until invalid and until valid."""
    notes.updates.clear()
    if fault == HANGING:
        method.until = time.monotonic() + FAULT_S
        began_ns = camera.clock.now_ns()
    else:
        camera.fault = FAULTS[fault]()
        began_ns = camera.good_ns[-1]
    time.sleep(FAULT_S)
    camera.fault = None
    ended_ns = camera.clock.now_ns()
    time.sleep(WELL_S)
    updates = list(notes.updates)
    invalid = next((each for each in updates if not each[0] and each[2] >= began_ns), None)
    if invalid is None:
        return {"fault": fault, "until_invalid_ms": None}
    last_ns = max((at for ok, at, out, _ in updates if ok and out <= invalid[2]), default=began_ns)
    if fault != HANGING:
        last_ns = began_ns
    again = next((each for each in updates if each[0] and each[2] >= ended_ns), None)
    first_ns = next((at for at in camera.good_ns if at >= ended_ns), ended_ns) if fault != HANGING else ended_ns
    wrongly = [each for each in updates if each[0] and each[2] > last_ns + 250_000_000 and each[2] < ended_ns]
    return {
        "fault": fault,
        "until_invalid_ms": round((invalid[2] - last_ns) * 1e-6, 1),
        "until_valid_ms": None if again is None else round((again[2] - first_ns) * 1e-6, 1),
        "valid_during": len(wrongly),
        "says": invalid[3],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    with TemporaryDirectory() as folder:
        path, info = write_input(Path(folder), 8.0)
        with open_source(path) as source:
            images = [event.image for event in source if isinstance(event, Frame)][:KEPT]
    camera, method, notes = FaultyCamera(images, info), Hanging(chosen.model), Notes()
    engine = Engine(camera, method, [notes], settings=LiveSettings(), clock=camera.clock)  # type: ignore[arg-type]
    rows = []
    with engine.running():
        engine.wait(WARM_S)
        for _ in range(chosen.rounds):
            for fault in (*FAULTS, HANGING):
                row = one(fault, camera, method, notes) | {"load": round(os.getloadavg()[0], 1)}
                rows.append(row)
                print(json.dumps(row), flush=True)
    if chosen.json:
        figures = {"machine": machine(), "rows": rows, "report": engine.report.figures()}
        chosen.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
