import json
import re
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tipforce.errors import InputError
from tipforce.live import LiveUpdate, Zero
from tipforce.live.streams import KINDS, SCHEMA_VERSION, LiveMessage, open_sink
from tipforce.live.streams._message import message_of
from tipforce.types import SessionInfo

PAGE = Path(__file__).parents[3] / "docs" / "streams.md"


def test_a_message_holds_what_was_estimated(update: Callable[..., LiveUpdate], info: SessionInfo) -> None:
    values = json.loads(message_of(update(), info, "pretrained/fusion").model_dump_json(by_alias=True))
    assert (values["schema"], values["session"], values["model"]) == (SCHEMA_VERSION, "bench", "pretrained/fusion")
    assert (values["status"], values["detail"]) == ("valid", "")
    assert values["force_n"] == [-0.15, 0.2, None]
    assert values["interval_n"] == [[-0.18, -0.12], [0.17, 0.23], [None, None]]
    assert (values["magnitude_n"], values["magnitude_interval_n"]) == (0.25, [0.22, 0.28])
    assert values["magnitude_g"] == pytest.approx(25.49, abs=0.01)
    assert values["latency_s"] == pytest.approx(0.012)
    assert values["captured_unix_s"] == pytest.approx(time.time() - 0.012, abs=0.5)
    # the tip lies 50 px to the right of the base and 50 px above it, at 0.2 mm a pixel, and points up: y of the base
    assert values["tip"]["position_mm"] == pytest.approx([10.0, 10.0])
    assert values["tip"]["direction"] == pytest.approx([0.0, 1.0])
    assert values["contact"]["state"] == "effective"


def test_an_invalid_one_holds_no_force_at_all(update: Callable[..., LiveUpdate], info: SessionInfo) -> None:
    update(0)
    values = json.loads(message_of(update(1, valid=False), info, "m").model_dump_json(by_alias=True))
    assert (values["status"], values["detail"]) == ("stale", "the camera is late: no image for 200 ms")
    force = ("force_n", "interval_n", "magnitude_n", "magnitude_interval_n", "magnitude_g", "tip")
    assert set(re.findall(r"[^\[\], ]+", json.dumps([values[name] for name in force]))) == {"null"}
    assert values["contact"]["state"] == "unknown"


def test_the_operators_zero_is_in_the_message(update: Callable[..., LiveUpdate], info: SessionInfo) -> None:
    zero = Zero(np.array([0.077, 0.0, np.nan]), 0.077, 5, 1.8e9, "page 2 at 10.0.0.7", confirmed=True)
    values = json.loads(message_of(replace(update(), zero=zero), info, "m").model_dump_json(by_alias=True))
    assert values["zero"] == {
        "offset_n": [0.077, 0.0, None], "magnitude_n": 0.077, "since_unix_s": 1.8e9, "by": "page 2 at 10.0.0.7",
        "confirmed": True,
    }  # fmt: skip
    assert message_of(update(), info, "m").zero is None


def test_the_tip_is_unknown_where_the_scale_is(update: Callable[..., LiveUpdate]) -> None:
    assert message_of(update(), SessionInfo("no scale"), "m").tip is None


def test_messages_keep_to_the_documented_schema(update: Callable[..., LiveUpdate], info: SessionInfo) -> None:
    schema = json.loads((PAGE.parent / "live-message.schema.json").read_text(encoding="utf-8"))
    assert schema == LiveMessage.model_json_schema(mode="serialization"), "run scripts/stream_schema.py"
    for valid in (True, False):
        text = message_of(update(valid=valid), info, "m").model_dump_json(by_alias=True)
        LiveMessage.model_validate_json(text, strict=True)
        values = json.loads(text)
        assert set(values) == set(schema["properties"]) == set(schema["required"])


def test_the_documented_example_is_a_message() -> None:
    found = re.search(r"```json\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert found
    assert LiveMessage.model_validate_json(found[1]).magnitude_n == 0.25


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("udp://127.0.0.1:9000", "there is no such kind of output"),
        ("run.mcap", "recording:run.mcap"),
        ("json-udp://127.0.0.1:port", "expected something like json-udp://127.0.0.1:9000"),
        ("json-udp://127.0.0.1:99999", "0-65535"),
        ("json-ws://127.0.0.1:0", "port 0"),
        ("igtl:slicer", "expected igtl://HOST:PORT"),
        ("json-ws://127.0.0.1:8767/force", "expected json-ws://HOST:PORT"),
        ("json-udp://127.0.0.1:9000?rate=5", "json-udp has no option rate; it has rate_hz"),
        ("json-ws://127.0.0.1:9000?origins=x", "it has origin"),
        ("json-udp://127.0.0.1:9000?rate", "bad query field"),
        ("recording:run.csv", "expected recording:FILE.mcap"),
        ("recording:run.mcap?frames=some", "expected yes or no"),
        ("lsl://name:4000", "expected lsl://NAME"),
    ],
)
def test_an_address_that_names_no_output_is_refused(text: str, said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)) as error:
        open_sink(text)
    assert str(error.value).startswith(f"out={text}")


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_has_an_example_that_opens(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    example = KINDS[kind][1]
    sink = open_sink(example)
    assert sink.name == example
    sink.close()
    assert not list(tmp_path.iterdir())
