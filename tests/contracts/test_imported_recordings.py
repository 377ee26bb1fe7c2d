"""A laboratory's own recording, imported with its bench.toml, satisfies every shipped model."""

from itertools import islice
from pathlib import Path

import pytest

import tipforce
from tipforce.errors import InputError
from tipforce.estimators import pretrained_names
from tipforce.types import SessionInfo, Status, ViewInfo


@pytest.mark.parametrize("name", pretrained_names())
def test_it_answers_a_recording_that_was_imported_with_a_bench_file(bench: Path, name: str) -> None:
    found = list(islice(tipforce.estimate(f"pretrained/{name}", bench / "runs" / "session_00.mcap"), 60))
    assert not [each.detail for each in found if each.status is Status.MISSING_INPUT]
    if name == "compact":  # dcfe was trained on images of another size and abstains from some of these
        assert sum(each.valid for each in found) > 0.9 * len(found)


@pytest.mark.parametrize("name", pretrained_names())
def test_a_video_needs_no_more_than_the_bench_file(bench: Path, name: str) -> None:
    session = bench / "session_00"
    first = next(tipforce.estimate(f"pretrained/{name}", session / "video.mp4", bench=session / "bench.toml"))
    assert first.status is not Status.MISSING_INPUT


def test_what_is_missing_is_asked_for_by_its_name_in_the_file(bench: Path) -> None:
    knob = {"knob_deg": 10.0}
    stated = SessionInfo(views={"camera": ViewInfo(base_side="left")})
    video = bench / "session_00" / "video.mp4"
    with pytest.raises(InputError, match=r"catheter\.diameter_m.*views\.camera\.metres_per_px.*bench\.toml"):
        next(tipforce.estimate("pretrained/compact", video, bench=stated, actuation=knob))
