"""Runs written as DICOM XA."""

import importlib

import numpy as np
import pytest

from tipforce.errors import InputError, MissingExtraError
from tipforce.simulation.rendering.fluoroscope import (
    BIPLANE,
    FLUORO_VARIED,
    RESEARCH_NOTE,
    XrayScene,
    sample_xray_scene,
    write_dicom,
)

pydicom = pytest.importorskip("pydicom")


@pytest.fixture(scope="module")
def scene() -> XrayScene:
    return sample_xray_scene(BIPLANE, np.random.default_rng(2))


@pytest.mark.parametrize("bits", [8, 10, 12])
def test_a_run_comes_back_as_it_was_written(tmp_path, scene: XrayScene, bits: int) -> None:
    rng = np.random.default_rng(bits)
    kind = np.uint8 if bits == 8 else np.uint16
    frames = [rng.integers(0, 1 << bits, (33, 35)).astype(kind) for _ in range(5)]
    stamps = [1_000, 66_668_000, 133_300_000, 266_700_000, 333_333_333]
    write_dicom(tmp_path / "run.dcm", frames, stamps, scene, view=1, bits=bits)
    data = pydicom.dcmread(tmp_path / "run.dcm")
    np.testing.assert_array_equal(data.pixel_array, np.stack(frames))
    steps = [float(step) for step in data.FrameTimeVector]
    np.testing.assert_allclose(np.cumsum(steps) * 1e6 + stamps[0], stamps, atol=5)
    assert data.FrameIncrementPointer == pydicom.tag.Tag("FrameTimeVector")
    assert data.SOPClassUID == pydicom.uid.XRayAngiographicImageStorage
    assert (data.Modality, data.ImageType[2], data.BitsStored) == ("XA", "BIPLANE B", bits)
    arm = scene.views[1].stated
    assert float(data.PositionerPrimaryAngle) == pytest.approx(arm.primary_deg, abs=0.01)
    assert float(data.PositionerSecondaryAngle) == pytest.approx(arm.secondary_deg, abs=0.01)
    distances = float(data.DistanceSourceToDetector), float(data.DistanceSourceToPatient)
    assert distances == pytest.approx((1e3 * arm.source_detector_m, 1e3 * arm.source_object_m), abs=1e-3)
    assert float(data.ImagerPixelSpacing[0]) == pytest.approx(1e3 * arm.imager_spacing_m(35), abs=1e-6)
    assert data.ImageComments == RESEARCH_NOTE


def test_every_attribute_that_the_modules_demand_is_there(tmp_path, scene: XrayScene) -> None:
    write_dicom(tmp_path / "run.dcm", [np.zeros((8, 8), np.uint8)] * 2, [0, 1], scene)
    data = pydicom.dcmread(tmp_path / "run.dcm")
    demanded = """
        PatientName PatientID PatientBirthDate PatientSex StudyInstanceUID StudyDate StudyTime StudyID
        ReferringPhysicianName AccessionNumber Modality SeriesInstanceUID SeriesNumber InstanceNumber ImageType
        PixelIntensityRelationship KVP RadiationSetting ExposureTime PositionerMotion PositionerPrimaryAngle
        PositionerSecondaryAngle Rows Columns SamplesPerPixel PhotometricInterpretation BitsAllocated BitsStored
        HighBit PixelRepresentation NumberOfFrames FrameIncrementPointer SOPClassUID SOPInstanceUID
    """
    assert [name for name in demanded.split() if name not in data] == []


def test_text_in_the_image_is_stated(tmp_path) -> None:
    scenes = [sample_xray_scene(FLUORO_VARIED, np.random.default_rng(seed)) for seed in range(8)]
    stated = []
    for number, varied in enumerate(scenes):
        write_dicom(tmp_path / f"{number}.dcm", [np.zeros((16, 16), np.uint8)], [0], varied)
        stated.append(str(pydicom.dcmread(tmp_path / f"{number}.dcm").BurnedInAnnotation))
    assert stated == ["YES" if any(each.variety.processing.text) else "NO" for each in scenes]
    assert set(stated) == {"YES", "NO"}


def test_planes_of_a_scene_share_a_study_and_are_two_images(tmp_path, scene: XrayScene) -> None:
    frames = [np.zeros((8, 8), np.uint8)] * 2
    for k in (0, 1):
        write_dicom(tmp_path / f"{k}.dcm", frames, [0, 66_000_000], scene, view=k)
    one, two = (pydicom.dcmread(tmp_path / f"{k}.dcm") for k in (0, 1))
    assert one.StudyInstanceUID == two.StudyInstanceUID
    assert one.SeriesInstanceUID == two.SeriesInstanceUID
    assert one.FrameOfReferenceUID == two.FrameOfReferenceUID
    assert len({one.SOPInstanceUID, two.SOPInstanceUID, one.StudyInstanceUID, one.FrameOfReferenceUID}) == 4
    assert one.PositionReferenceIndicator == ""
    write_dicom(tmp_path / "again.dcm", frames, [0, 66_000_000], scene, view=1)
    assert (tmp_path / "again.dcm").read_bytes() == (tmp_path / "1.dcm").read_bytes()


def test_another_scene_is_another_frame_of_reference(tmp_path, scene: XrayScene) -> None:
    other = sample_xray_scene(BIPLANE, np.random.default_rng(3))
    for name, each in (("one", scene), ("two", other)):
        write_dicom(tmp_path / f"{name}.dcm", [np.zeros((8, 8), np.uint8)], [0], each)
    one, two = (pydicom.dcmread(tmp_path / f"{name}.dcm") for name in ("one", "two"))
    assert one.FrameOfReferenceUID.is_valid
    assert one.FrameOfReferenceUID != two.FrameOfReferenceUID


@pytest.mark.parametrize(
    ("frames", "stamps", "match"),
    [
        ([np.zeros((8, 8), np.uint8)] * 2, [5, 5], "rising stamps"),
        ([np.zeros((8, 8), np.uint8)] * 2, [5], "rising stamps"),
        ([np.zeros((8, 8), np.uint8), np.zeros((8, 9), np.uint8)], [0, 1], "one shape"),
        ([np.zeros((8, 8), np.uint16)], [0], "uint8"),
        ([], [], "one shape"),
    ],
)
def test_frames_that_make_no_run_are_refused(tmp_path, scene: XrayScene, frames, stamps, match: str) -> None:
    with pytest.raises(InputError, match=match):
        write_dicom(tmp_path / "run.dcm", frames, stamps, scene)
    assert not (tmp_path / "run.dcm").exists()


def test_without_pydicom_the_install_line_is_named(tmp_path, scene: XrayScene, monkeypatch: pytest.MonkeyPatch) -> None:
    real = importlib.import_module

    def gone(name: str, package: str | None = None):
        if name == "pydicom":
            raise ModuleNotFoundError(name)
        return real(name, package)

    monkeypatch.setattr(importlib, "import_module", gone)
    with pytest.raises(MissingExtraError, match=r"in the checkout of tipforce, run: pip install -e '.\[dicom\]'"):
        write_dicom(tmp_path / "run.dcm", [np.zeros((8, 8), np.uint8)], [0], scene)
