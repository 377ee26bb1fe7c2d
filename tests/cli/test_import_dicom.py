"""``tipforce import`` of DICOM: the pose and scale of the views come from the header, with their uncertainties."""

import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce.cli import app
from tipforce.errors import FileFormatError, TimeError
from tipforce.geometry import CArm
from tipforce.io import RecordingReader, open_source
from tipforce.types import Frame, SessionInfo, ViewInfo

pydicom = pytest.importorskip("pydicom")

ARMS = {"a": (-30.0, 10.0), "b": (60.0, -5.0)}
GEOMETRY = {
    "DistanceSourceToDetector": "1100",
    "DistanceSourceToPatient": "750",
    "ImagerPixelSpacing": ["0.4", "0.4"],
}
SCALE = 0.4e-3 * 750 / 1100


def write_xray(path, plane="a", frames=3, **tags):
    """Writes a run of 24 x 16 px as a biplane system does; a tag of None is left out."""
    primary, secondary = ARMS[plane]
    meta = pydicom.dataset.FileMetaDataset()
    meta.MediaStorageSOPClassUID = pydicom.uid.XRayAngiographicImageStorage
    meta.MediaStorageSOPInstanceUID = pydicom.uid.generate_uid()
    meta.TransferSyntaxUID = tags.pop("syntax", pydicom.uid.ExplicitVRLittleEndian)
    data = pydicom.dataset.Dataset()
    data.file_meta = meta
    data.SOPClassUID, data.SOPInstanceUID = meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID
    stated = {
        "Modality": "XA",
        "ImageType": ["ORIGINAL", "PRIMARY", f"BIPLANE {plane.upper()}"],
        "ContentDate": "20260301",
        "ContentTime": "101500.25",
        "PositionerPrimaryAngle": primary,
        "PositionerSecondaryAngle": secondary,
        **GEOMETRY,
        "NumberOfFrames": frames,
        "FrameTime": "66.0",
        "Rows": 16,
        "Columns": 24,
        "SamplesPerPixel": 1,
        "PhotometricInterpretation": "MONOCHROME2",
        "BitsAllocated": 8,
        "BitsStored": 8,
        "HighBit": 7,
        "PixelRepresentation": 0,
        **tags,
    }
    for name, value in stated.items():
        if value is not None:
            setattr(data, name, value)
    pixels = np.random.default_rng(frames).integers(60, 200, (frames, 16, 24), np.uint8).tobytes()
    data.PixelData = pydicom.encaps.encapsulate([pixels]) if meta.TransferSyntaxUID.is_compressed else pixels
    if meta.TransferSyntaxUID.is_compressed:
        data["PixelData"].is_undefined_length = True
    data.save_as(path, enforce_file_format=True)
    return path


def gone(to, **tags):
    """Tags of a header without the distance from the focal spot to "Patient" or "Detector"."""
    return {f"DistanceSourceTo{to}": None, **tags}


def imported(tmp_path, *files, more=()):
    target = tmp_path / "run.mcap"
    result = CliRunner().invoke(app, ["import", *map(str, files), *more, "-o", str(target)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    with RecordingReader(target) as reader:
        return reader.session_info, " ".join(result.output.split())


def view_of(path):
    with open_source(path) as source:
        return source.session_info.view("camera")


def test_two_files_are_a_biplane_pair_with_pose_scale_and_uncertainties(tmp_path):
    files = write_xray(tmp_path / "IM_0001.dcm"), write_xray(tmp_path / "IM_0002.dcm", "b")
    info, said = imported(tmp_path, *files)
    assert list(info.views) == ["a", "b"]
    for name, (primary, secondary) in ARMS.items():
        view = info.view(name)
        assert view.metres_per_px == pytest.approx(SCALE, rel=1e-5)
        assert view.metres_per_px_uncertainty == pytest.approx(np.hypot(30.0, 5.0) / 750.0, rel=0.02)
        camera = CArm(primary, secondary, 1.1, 0.75, SCALE * 24 / 512).camera(24, 16)
        np.testing.assert_allclose(view.projection, camera.projection_matrix, rtol=1e-4, atol=1e-6)
        assert (view.projection_frame, view.modality) == ("isocentre", "xray")
        assert view.pose_uncertainty_deg == (1.0, 1.0, 0.5)
        assert view.pose_uncertainty_m == (2e-3, 2e-3, 5e-3)
    assert "view a: C-arm at RAO 30, cranial 10 degrees, +- 1 assumed; 0.2727 mm a pixel at the isocentre" in said
    assert "view b: C-arm at LAO 60, caudal 5 degrees" in said


def test_a_point_projected_by_the_pose_is_where_the_magnification_puts_it(tmp_path):
    matrix = np.array(
        view_of(write_xray(tmp_path / "run.dcm", PositionerPrimaryAngle=0, PositionerSecondaryAngle=0)).projection
    )
    left = matrix @ [1e-3, 0.0, 0.0, 1.0]  # a millimetre to the patient's left is 1 mm / 0.2727 mm to the right
    np.testing.assert_allclose(left[:2] / left[2], [11.5 + 1e-3 / SCALE, 7.5], rtol=1e-5)


@pytest.mark.parametrize(
    ("tags", "scale", "share", "said"),
    [
        (gone("Patient", EstimatedRadiographicMagnificationFactor="1.5"), 0.4e-3 / 1.5, 0.041, ""),
        (gone("Patient"), SCALE, 0.067, "DistanceSourceToPatient is missing: 750 +- 40 mm are assumed"),
        (gone("Detector", EstimatedRadiographicMagnificationFactor="1.5"), 0.4e-3 / 1.5, 0.041, ""),
        (
            gone("Patient", DistanceSourceToDetector="0"),
            0.4e-3 / 1.4,
            0.095,
            "magnification of 1.4 +- 0.12 is assumed",
        ),
        (
            {"ImagerPixelSpacing": None, "PixelSpacing": ["0.3", "0.3"], "PixelSpacingCalibrationType": "GEOMETRY"},
            0.3e-3,
            0.041,
            "",
        ),
    ],
)
def test_what_the_header_leaves_open_makes_the_scale_less_sure(tmp_path, tags, scale, share, said):
    info, output = imported(tmp_path, write_xray(tmp_path / "run.dcm", **tags))
    assert info.view("camera").metres_per_px == pytest.approx(scale, rel=1e-4)
    assert info.view("camera").metres_per_px_uncertainty == pytest.approx(share, abs=2e-3)
    assert said in output


@pytest.mark.parametrize(
    ("tags", "said"),
    [
        ({"PositionerPrimaryAngle": None}, "PositionerPrimaryAngle is missing, so the pose is not known"),
        ({"PositionerPrimaryAngleIncrement": [0.0, 5.0, 10.0]}, "the C-arm turns by 10 degrees during the run"),
        ({"FieldOfViewHorizontalFlip": "YES"}, "the image is shown turned by 0 degrees or mirrored"),
    ],
)
def test_without_a_pose_the_scale_stays_and_the_line_of_bench_toml_is_named(tmp_path, tags, said):
    info, output = imported(tmp_path, write_xray(tmp_path / "run.dcm", **tags))
    assert info.view("camera").projection is None
    assert info.view("camera").metres_per_px == pytest.approx(SCALE, rel=1e-5)
    assert said in output
    assert "state views.camera.projection in bench.toml" in output


def test_without_pixel_spacing_the_advice_of_the_message_gives_the_scale(tmp_path):
    path = write_xray(tmp_path / "run.dcm", ImagerPixelSpacing=None)
    info, output = imported(tmp_path, path)
    assert info.view("camera").metres_per_px is None
    assert "ImagerPixelSpacing is missing" in output
    (tmp_path / "run.mcap").unlink()
    info, output = imported(tmp_path, path, more=["--fact", "views.camera.metres_per_px=2.5e-4"])
    assert info.view("camera").metres_per_px == 2.5e-4
    assert "ImagerPixelSpacing" not in output


def test_a_stated_scale_and_pose_win_and_a_contradiction_is_remarked(tmp_path):
    rows = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    stated = SessionInfo(views={"camera": ViewInfo(5e-4, projection=rows, projection_frame="base")})
    with open_source(write_xray(tmp_path / "run.dcm"), stated=stated) as source:
        found = source.session_info.view("camera")
    assert (found.metres_per_px, found.projection, found.projection_frame) == (5e-4, rows, "base")
    assert (found.metres_per_px_uncertainty, found.pose_uncertainty_deg) == (None, None)
    _, output = imported(tmp_path, tmp_path / "run.dcm", more=["--fact", "views.camera.metres_per_px=5e-4"])
    assert "views.camera.metres_per_px of bench.toml is 1.83 times the scale of the header" in output


def test_a_moving_table_is_remarked(tmp_path):
    info, output = imported(tmp_path, write_xray(tmp_path / "run.dcm", TableVerticalIncrement=[0.0, 20.0, 40.0]))
    assert "the table moves during the run (vertical 40 mm)" in output
    assert info.view("camera").metres_per_px_uncertainty == pytest.approx(np.hypot(30.4, 40 / 12**0.5) / 750, rel=0.03)


def test_planes_that_begin_apart_are_placed_on_one_clock(tmp_path):
    files = write_xray(tmp_path / "x_a.dcm"), write_xray(tmp_path / "x_b.dcm", "b", ContentTime="101500.283")
    target = tmp_path / "run.mcap"
    result = CliRunner().invoke(app, ["import", *map(str, files), "-o", str(target)], catch_exceptions=False)
    assert "x_b.dcm: its stamps are 0.033000 s later, because its ContentTime is" in " ".join(result.output.split())
    with RecordingReader(target) as reader:
        stamps = {view: reader.stamps(view).tolist() for view in reader.views}
    assert stamps == {"a": [0, 66_000_000, 132_000_000], "b": [33_000_000, 99_000_000, 165_000_000]}


def test_runs_of_different_times_are_no_pair(tmp_path):
    files = write_xray(tmp_path / "x_a.dcm"), write_xray(tmp_path / "x_b.dcm", "b", ContentTime="101700.25")
    result = CliRunner().invoke(app, ["import", *map(str, files), "-o", str(tmp_path / "run.mcap")])
    assert isinstance(result.exception, TimeError)
    assert "x_b.dcm: begins 119.9 s after the end of x_a.dcm, by their ContentTime" in str(result.exception)
    assert not (tmp_path / "run.mcap").exists()


def test_compression_without_a_decoder_names_what_to_install(tmp_path, monkeypatch):
    path = write_xray(tmp_path / "run.dcm", syntax=pydicom.uid.JPEGLosslessSV1)
    decoder = pydicom.pixels.get_decoder(pydicom.uid.JPEGLosslessSV1)
    monkeypatch.setattr(type(decoder), "is_available", property(lambda self: False))
    with pytest.raises(FileFormatError, match=r"JPEG Lossless.*pip install python-gdcm.*gdcmconv"):
        open_source(path)


def test_run_length_compression_needs_no_further_decoder(tmp_path):
    path = write_xray(tmp_path / "run.dcm")
    with open_source(path) as source:
        plain = [event.image for event in source if isinstance(event, Frame)]
    data = pydicom.dcmread(path)
    data.compress(pydicom.uid.RLELossless)
    data.save_as(path)
    with open_source(path) as source:
        packed = [event.image for event in source if isinstance(event, Frame)]
    np.testing.assert_array_equal(plain, packed)


@pytest.mark.parametrize(
    ("tags", "said"),
    [
        ({"DistanceSourceToPatient": "1200"}, "DistanceSourceToPatient is 1200 mm, behind the detector"),
        ({"ImagerPixelSpacing": ["0.4", "0"]}, "ImagerPixelSpacing is"),
        ({"PositionerPrimaryAngle": 400.0}, "the positioner's angles are 400 and 10 degrees"),
    ],
)
def test_an_impossible_geometry_is_not_used(tmp_path, tags, said):
    info, output = imported(tmp_path, write_xray(tmp_path / "run.dcm", **tags))
    assert info.view("camera") == ViewInfo(modality="xray")
    assert f"its header is not used for the geometry: {said}" in output
    assert "state views.camera.metres_per_px, and for two views views.camera.projection, in bench.toml" in output
