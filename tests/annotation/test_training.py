"""The training beside the page: progress, cancel, failure, and the sentence where torch is missing."""

import re
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tipforce.annotation import TrainingRun
from tipforce.errors import MissingExtraError

from .conftest import FakeDetector  # type: ignore[import-not-found]


def eventually(condition: Callable[[], object]) -> None:
    end = time.monotonic() + 5.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


def test_progress_is_shown_until_the_result(tmp_path: Path) -> None:
    gate = threading.Event()

    def fine_tune(annotations, images, report):
        report("step 3 of 10", 0.3)
        gate.wait(5.0)
        return FakeDetector(tmp_path, 1.0, ())

    run = TrainingRun(fine_tune)
    assert run.status.state == "idle"
    run.start([], [])
    eventually(lambda: run.status.share == 0.3)
    assert run.status.state == "running"
    assert run.status.step == "step 3 of 10"
    gate.set()
    eventually(lambda: run.status.state == "done")
    assert run.status.message == str(tmp_path)


def test_a_training_is_cancelled_at_its_next_step() -> None:
    def fine_tune(annotations, images, report):
        while True:
            report("step", 0.1)
            time.sleep(0.005)

    run = TrainingRun(fine_tune)
    run.start([], [])
    run.start([], [])  # one at a time
    run.close()
    assert not run.running
    assert run.status.state == "cancelled"


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (
            MissingExtraError("torch", extra="train"),
            r"torch is not installed; .*pip install -e '\.\[train\]'; the anno",
        ),
        (ValueError("3"), r"the training failed \(ValueError: 3\); the annotations are saved"),
    ],
)
def test_a_failure_is_one_sentence(error: Exception, message: str) -> None:
    def fine_tune(annotations, images, report):
        raise error

    run = TrainingRun(fine_tune)
    run.start([], [])
    eventually(lambda: run.status.state == "failed")
    assert re.search(message, run.status.message)
