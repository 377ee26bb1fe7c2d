import random
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from tipforce.errors import FileFormatError, OutputError
from tipforce.io import RecordingReader, RecordingWriter, check_target, recover_recording
from tipforce.types import Actuation, SessionInfo, Wrench


def events_of(path: Path) -> list[tuple[int, float]]:
    with RecordingReader(path) as reader:
        return [(e.stamp_ns, float(e.force_n[0])) for e in reader.events("force") if isinstance(e, Wrench)]


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(share=st.floats(0.02, 1.0))
def test_a_file_cut_anywhere_gives_back_every_message_before_the_cut(recording: Path, share: float) -> None:
    raw = recording.read_bytes()
    cut = recording.with_name("cut.mcap.part")
    cut.write_bytes(raw[: max(int(share * len(raw)), 2500)])
    target = recording.with_name("cut.mcap")
    target.unlink(missing_ok=True)
    with pytest.warns(UserWarning, match="messages recovered"):
        reader = RecordingReader(cut)
    with reader:
        found, _, _ = reader.wrenches()
        assert reader.path == target
        assert ("was whole" if share == 1.0 else "was cut off") in reader.info.recovered
    assert not cut.exists()
    # every reading takes the same room, so what lies before the cut can be told from its length
    whole = np.arange(len(found)) * 1_000_000
    np.testing.assert_array_equal(found, whole)
    missing = raw[: int(share * len(raw))].count(b"sensor\0") - len(found)
    assert missing <= 1  # the one that was cut itself


def test_a_recording_killed_while_it_was_written_is_recovered_when_opened(tmp_path: Path) -> None:
    script = (
        "import os, signal, sys, time, numpy as np\n"
        "from tipforce.io import RecordingWriter\n"
        "from tipforce.types import SessionInfo, Wrench\n"
        f"writer = RecordingWriter({str(tmp_path / 'run.mcap')!r}, SessionInfo('killed'))\n"
        "for k in range(100):\n"
        "    writer.write(Wrench(k * 10**6, np.full(3, float(k)), np.zeros(3)))\n"
        "time.sleep(0.7)\n"  # nothing arrives any more: what is pending must reach the file all the same
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == -9
    path = tmp_path / "run.mcap"
    assert not path.exists()
    with pytest.warns(UserWarning, match=r"run\.mcap was cut off: 100 messages recovered"):
        assert len(events_of(path)) == 100
    with RecordingReader(path) as reader:
        assert reader.session_info.name == "killed"


def test_an_error_while_recording_keeps_what_was_recorded(tmp_path: Path) -> None:
    def unplugged() -> Iterator[Actuation]:
        yield Actuation(0, {"a_mm": 1.0})
        raise ConnectionError

    def record() -> None:
        with RecordingWriter(tmp_path / "run.mcap", SessionInfo()) as writer:
            for event in unplugged():
                writer.write(event)

    with pytest.raises(ConnectionError):
        record()
    assert not (tmp_path / "run.mcap").exists()
    with pytest.warns(UserWarning, match="1 messages recovered"), RecordingReader(tmp_path / "run.mcap") as reader:
        assert reader.info.streams["joints"].count == 1


def test_a_damaged_chunk_costs_only_itself(recording: Path) -> None:
    raw = bytearray(recording.read_bytes())
    place = raw.find(b"sensor\0", len(raw) // 4)
    raw[place + 20] ^= 0xFF
    part = recording.with_name("hurt.mcap.part")
    part.write_bytes(raw)
    with pytest.warns(UserWarning, match="1 damaged chunks lost"), RecordingReader(part) as reader:
        left = len(reader.wrenches()[0])
    assert 400 <= left < 1000


def test_what_is_still_being_written_is_left_alone(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "run.mcap", SessionInfo()) as writer:
        writer.write(Actuation(0, {"a_mm": 1.0}))
        with pytest.raises(FileFormatError, match="still being written by this process"):
            RecordingReader(tmp_path / "run.mcap")
        for overwrite in (False, True):
            with pytest.raises(OutputError, match=r"run.mcap: is being written by this process; wait until it ends"):
                RecordingWriter(tmp_path / "run.mcap", SessionInfo(), overwrite=overwrite)
    with RecordingReader(tmp_path / "run.mcap") as reader:
        assert reader.info.streams["joints"].count == 1


def test_another_process_that_writes_a_recording_is_named(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    script = (
        "import sys; from tipforce.io import RecordingWriter; from tipforce.types import *\n"
        "with RecordingWriter(sys.argv[1], SessionInfo()) as writer:\n"
        "    writer.write(Actuation(0, {'a_mm': 1.0}))\n"
        "    print('ready', flush=True); sys.stdin.readline()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdin is not None
        assert other.stdout.readline() == "ready\n"
        with pytest.raises(OutputError, match=rf"is being written by process {other.pid} \(tipforce") as refused:
            check_target(path, overwrite=False, origin="live")
        assert "remove" not in str(refused.value)
        with pytest.raises(FileFormatError, match=f"still being written by process {other.pid}"):
            RecordingReader(path)
        other.stdin.write("\n")
    with RecordingReader(path) as reader:
        assert reader.info.streams["joints"].count == 1


def test_a_recording_that_waits_for_recovery_is_not_written_over(recording: Path) -> None:
    part = recording.with_name("other.mcap.part")
    part.write_bytes(recording.read_bytes()[:20_000])
    with pytest.raises(FileFormatError, match="tipforce import"):
        RecordingWriter(recording.with_name("other.mcap"), SessionInfo())
    assert part.stat().st_size == 20_000


def test_a_part_beside_a_finished_file_is_not_recovered_over_it(recording: Path) -> None:
    part = recording.with_name(recording.name + ".part")
    part.write_bytes(recording.read_bytes()[:20_000])
    assert len(events_of(recording)) == 1000
    with pytest.raises(FileFormatError, match="exists too"):
        RecordingReader(part)
    assert part.exists()


def test_a_part_without_a_message_says_that_nothing_is_in_it(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), RecordingWriter(tmp_path / "run.mcap", SessionInfo()):
        raise ZeroDivisionError
    with pytest.raises(FileFormatError, match="nothing is in it"):
        RecordingReader(tmp_path / "run.mcap")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.mcap.part"]


def test_a_truncated_recording_says_how_to_recover_it(recording: Path) -> None:
    raw = recording.read_bytes()
    recording.write_bytes(raw[: len(raw) // 2])
    with pytest.raises(FileFormatError, match=r"tipforce import \S+run\.mcap -o \S+run-recovered\.mcap"):
        RecordingReader(recording)
    target = recording.with_name("run-recovered.mcap")
    assert recover_recording(recording, target).startswith("run.mcap was cut off")
    assert len(events_of(target)) > 300
    assert recording.exists()


def test_a_part_cut_within_its_first_records_is_one_sentence(recording: Path) -> None:
    raw = recording.read_bytes()
    recording.unlink()
    part = recording.with_name(recording.name + ".part")
    for length in range(260):
        part.write_bytes(raw[:length])
        with pytest.raises(FileFormatError) as caught:
            RecordingReader(recording)
        assert str(recording) in str(caught.value)
    assert [path.name for path in part.parent.iterdir()] == [part.name]


def test_a_flipped_bit_anywhere_in_a_recording_is_reported(recording: Path) -> None:
    raw = recording.read_bytes()
    chance = random.Random(0)
    # everywhere, and densely where there are no chunks: the metadata at the beginning, the index at the end
    places = [
        *range(0, 600, 7),
        *range(len(raw) - 3000, len(raw), 11),
        *(chance.randrange(len(raw)) for _ in range(60)),
    ]
    for place in places:
        hurt = bytearray(raw)
        hurt[place] ^= 1 << chance.randrange(8)
        recording.write_bytes(hurt)
        with pytest.raises(FileFormatError, match=r"run\.mcap: ") as caught, RecordingReader(recording) as reader:
            list(reader.events())
        assert "\n" not in str(caught.value)


def test_a_damaged_stretch_is_named_by_its_time_and_left_out_on_request(recording: Path) -> None:
    raw = bytearray(recording.read_bytes())
    place = raw.find(b"sensor\0", len(raw) // 4)
    raw[place + 20] ^= 0x01
    recording.write_bytes(raw)
    with (
        RecordingReader(recording) as reader,
        pytest.raises(FileFormatError, match=r"from \d\.\d{3} to \d\.\d{3} s is"),
    ):
        reader.wrenches()
    target = recording.with_name("whole.mcap")
    said = recover_recording(recording, target)
    assert "1 damaged chunks lost (0." in said
    assert "metadata" not in said
    with RecordingReader(target) as reader:
        assert 400 <= len(reader.wrenches()[0]) < 1000
        assert reader.info.recovered == said


def test_a_chunk_whose_head_is_hurt_costs_only_itself(recording: Path) -> None:
    raw = bytearray(recording.read_bytes())
    with recording.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    for start in (summary.chunk_indexes[1].chunk_start_offset, summary.chunk_indexes[1].chunk_start_offset + 7):
        hurt = bytearray(raw)
        hurt[start] ^= 0x40
        recording.write_bytes(hurt)
        with pytest.raises(FileFormatError, match="differ from their checksum"):
            RecordingReader(recording)
        said = recover_recording(recording, recording.with_name("whole.mcap"), overwrite=True)
        assert "1 damaged chunks lost" in said
        assert "metadata" in said  # they have no checksum of their own


def test_metadata_that_may_be_damaged_are_said_to_be_so(recording: Path) -> None:
    raw = recording.read_bytes()
    recording.write_bytes(raw.replace(b"tipforce.session", b"tipforce.sessiom", 1))
    assert "metadata (session, tare, clock map) may be damaged" in recover_recording(
        recording, recording.with_name("whole.mcap")
    )


def test_recordings_without_checksums_are_read_as_before(recording: Path) -> None:
    raw = bytearray(recording.read_bytes())
    with recording.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    (start,) = struct.unpack_from("<Q", raw, len(raw) - 28)
    raw[start - 4 : start] = bytes(4)
    raw[-12:-8] = bytes(4)
    for chunk in summary.chunk_indexes:
        raw[chunk.chunk_start_offset + 33 : chunk.chunk_start_offset + 37] = bytes(4)
    before = events_of(recording)
    recording.write_bytes(raw)
    assert events_of(recording) == before


@pytest.mark.parametrize("length", [0, 1, 2**63, 2**64 - 1])
def test_an_index_that_states_no_length_of_a_chunk_ends_the_recovery_all_the_same(recording: Path, length: int) -> None:
    with recording.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    raw, chunk = recording.read_bytes(), summary.chunk_indexes[0]
    place = raw.rindex(struct.pack("<QQ", chunk.chunk_start_offset, chunk.chunk_length)) + 8
    raw = raw[:place] + struct.pack("<Q", length) + raw[place + 8 :]
    damaged = recording.with_name("odd.mcap.part")
    damaged.write_bytes(raw[:-12] + bytes(4) + raw[-8:])  # the checksum of the index is not stated
    with pytest.warns(UserWarning, match="messages recovered"), RecordingReader(damaged) as reader:
        assert len(reader.stamps("force")) < 1000
