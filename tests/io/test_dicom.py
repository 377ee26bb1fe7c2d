"""DICOM files as a source of frames."""

import importlib

import numpy as np
import pytest

from tipforce.errors import FileFormatError, MissingExtraError, TimeError
from tipforce.io import open_source
from tipforce.simulation.rendering.fluoroscope import FLUORO, sample_xray_scene, write_dicom
from tipforce.types import Frame

pydicom = pytest.importorskip("pydicom")
STAMPS = [5_000_000, 71_000_000, 140_000_000, 290_000_000]


def written(path, bits=8):
    rng = np.random.default_rng(bits)
    frames = [rng.integers(0, 1 << bits, (16, 24)).astype(np.uint8 if bits == 8 else np.uint16) for _ in STAMPS]
    write_dicom(path, frames, STAMPS, sample_xray_scene(FLUORO, np.random.default_rng(1)), bits=bits)
    return frames


def frames_of(path):
    with open_source(path) as source:
        return [event for event in source if isinstance(event, Frame)]


@pytest.mark.parametrize("bits", [8, 12])
def test_frames_come_with_their_own_times(tmp_path, bits):
    frames = written(tmp_path / "no_suffix", bits)  # DICOM files are called anything
    found = frames_of(tmp_path / "no_suffix")
    assert [frame.stamp_ns for frame in found] == STAMPS
    for frame, true in zip(found, frames, strict=True):
        np.testing.assert_array_equal(frame.image, (true >> (bits - 8)).astype(np.uint8))


def changed(path, **tags):
    data = pydicom.dcmread(path)
    for name, value in tags.items():
        if value is None:
            delattr(data, name)
        else:
            setattr(data, name, value)
    data.save_as(path)


def test_a_constant_frame_time_does_and_so_does_the_rate(tmp_path):
    written(tmp_path / "run.dcm")
    changed(tmp_path / "run.dcm", FrameTimeVector=None, FrameTime="66.5")
    stamps = [frame.stamp_ns for frame in frames_of(tmp_path / "run.dcm")]
    assert stamps == [5_000_000, 71_500_000, 138_000_000, 204_500_000]
    changed(tmp_path / "run.dcm", FrameTime=None, CineRate=10)
    assert [frame.stamp_ns for frame in frames_of(tmp_path / "run.dcm")][-1] == 305_000_000


def test_without_a_delay_the_first_frame_is_at_zero(tmp_path):
    written(tmp_path / "run.dcm")
    changed(tmp_path / "run.dcm", FrameDelay=None)
    assert [frame.stamp_ns for frame in frames_of(tmp_path / "run.dcm")] == [stamp - STAMPS[0] for stamp in STAMPS]


def test_images_stored_bright_for_dark_are_turned_round(tmp_path):
    frames = written(tmp_path / "run.dcm")
    changed(tmp_path / "run.dcm", PhotometricInterpretation="MONOCHROME1")
    np.testing.assert_array_equal(frames_of(tmp_path / "run.dcm")[0].image, 255 - frames[0])


def test_what_does_not_say_when_is_refused(tmp_path):
    written(tmp_path / "run.dcm")
    changed(tmp_path / "run.dcm", FrameTimeVector=None, CineRate=None)
    with pytest.raises(TimeError, match="does not say when its 4 frames were taken"):
        frames_of(tmp_path / "run.dcm")


def test_a_cut_off_file_says_so(tmp_path):
    written(tmp_path / "run.dcm")
    whole = (tmp_path / "run.dcm").read_bytes()
    (tmp_path / "run.dcm").write_bytes(whole[: len(whole) - 700])
    with pytest.raises(FileFormatError, match=r"run\.dcm: "):
        frames_of(tmp_path / "run.dcm")


def test_without_pydicom_the_install_line_is_named(tmp_path, monkeypatch):
    written(tmp_path / "run.dcm")
    real = importlib.import_module

    def gone(name, package=None):
        if name == "pydicom":
            raise ModuleNotFoundError(name)
        return real(name, package)

    monkeypatch.setattr(importlib, "import_module", gone)
    with pytest.raises(MissingExtraError, match=r"pip install -e '\.\[dicom\]'"):
        open_source(tmp_path / "run.dcm")


@pytest.mark.parametrize(
    ("tags", "said"),
    [
        ({"Rows": 60_000, "Columns": 60_000}, "claims 60000 x 60000 pixels, more than the limit of 100 megapixels"),
        ({"NumberOfFrames": 1_000_000_000}, "claims 1000000000 frames, which a file of .* bytes cannot hold"),
        ({"NumberOfFrames": 9, "FrameTimeVector": None, "FrameTime": "66"}, "cannot be decoded"),
    ],
)
def test_claims_of_the_header_that_the_file_cannot_keep_are_refused(tmp_path, tags, said):
    written(tmp_path / "run.dcm")
    changed(tmp_path / "run.dcm", **tags)
    with pytest.raises(FileFormatError, match=said):
        frames_of(tmp_path / "run.dcm")


@pytest.mark.parametrize(
    "tags", [{"FrameDelay": [1, 2]}, {"FrameTimeVector": "7"}, {"SamplesPerPixel": [1, 2]}, {"BitsStored": [8, 8]}]
)
def test_a_damaged_header_is_one_sentence(tmp_path, tags):
    written(tmp_path / "run.dcm")
    changed(tmp_path / "run.dcm", **tags)
    with pytest.raises(FileFormatError, match=r"run\.dcm: its header is damaged"):
        frames_of(tmp_path / "run.dcm")
