"""Annotations of other programs, in the formats that these document, and our own."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.interpolate import splprep

from tipforce.annotation import AnnotationImages, AnnotationStore, MarkedFrame, import_marks, read_marks, write_marks
from tipforce.errors import InputError

OURS = "image,u,v\nimg000.png,10,20\nimg000.png,40,24.5\nimg000.png,80,60\nimg001.png,10,21\nimg001.png,70,70\n"
SLEAP = (
    "track,frame_idx,instance.score,base.x,base.y,base.score,middle.x,middle.y,middle.score,tip.x,tip.y,tip.score\n"
    "track_0,0,0.93,10,20,0.97,40,24.5,0.9,80,60,0.88\n"
    ",1,,,,,,,,,,\n"
    "track_0,2,0.9,10,21,0.9,,,,70,70,0.9\n"
)
DLC_LABELS = (
    "scorer,,,Ann,Ann,Ann,Ann,Ann,Ann\n"
    "bodyparts,,,base,base,middle,middle,tip,tip\n"
    "coords,,,x,y,x,y,x,y\n"
    "labeled-data,monday,img000.png,10,20,40,24.5,80,60\n"
    "labeled-data,monday,img002.png,10,21,,,70,70\n"
)
DLC_OLD_LABELS = (
    "scorer,Ann,Ann,Ann,Ann,Ann,Ann\n"
    "bodyparts,base,base,middle,middle,tip,tip\n"
    "coords,x,y,x,y,x,y\n"
    "labeled-data\\monday\\img000.png,10,20,40,24.5,80,60\n"
    "labeled-data/monday/img002.png,10,21,,,70,70\n"
)
DLC_PREDICTIONS = (
    "scorer,DLC_resnet50,DLC_resnet50,DLC_resnet50,DLC_resnet50,DLC_resnet50,DLC_resnet50,DLC_resnet50,DLC_resnet50,"
    "DLC_resnet50\n"
    "bodyparts,base,base,base,middle,middle,middle,tip,tip,tip\n"
    "coords,x,y,likelihood,x,y,likelihood,x,y,likelihood\n"
    "0,10,20,0.99,40,24.5,0.98,80,60,0.97\n"
    "1,10,20,0.99,40,24.5,0.98,80,60,0.12\n"
    "2,10,21,0.99,3,4,0.01,70,70,0.97\n"
)
DLC_MULTI = (
    "scorer,,,Ann,Ann,Ann,Ann\nindividuals,,,a,a,a,a\nbodyparts,,,base,base,tip,tip\ncoords,,,x,y,x,y\n"
    "labeled-data,monday,img000.png,10,20,80,60\n"
)
COCO = {
    "images": [
        {"id": 7, "file_name": "frames/img000.png", "width": 320, "height": 240},
        {"id": 8, "file_name": "img002.png", "width": 320, "height": 240},
        {"id": 9, "file_name": "img003.png"},
    ],
    "annotations": [
        {"id": 1, "image_id": 7, "category_id": 1, "keypoints": [10, 20, 2, 40, 24.5, 2, 80, 60, 2]},
        {"id": 2, "image_id": 8, "category_id": 1, "keypoints": [10, 21, 2, 0, 0, 0, 70, 70, 1]},
    ],
    "categories": [{"id": 1, "name": "catheter", "keypoints": ["base", "middle", "tip"]}],
}


def taken(file: Path, folder: Path) -> dict[str, list[list[float]]]:
    """Image -> points of its line, after an import of ``file``."""
    store = AnnotationStore(folder)
    import_marks(file, AnnotationImages(folder), store)
    return {name: frame.points_px.tolist() for name, frame in store.frames.items()}


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("ours.csv", OURS.replace("img001", "img002")),
        ("semicolons.csv", OURS.replace("img001", "img002").replace(",", ";")),
        ("numbers.csv", OURS.replace("img000.png", "0").replace("img001.png", "2")),
        ("sleap.csv", SLEAP),
        ("CollectedData_Ann.csv", DLC_LABELS),
        ("old_labels.csv", DLC_OLD_LABELS),
        ("predictions.csv", DLC_PREDICTIONS),
        ("coco.json", json.dumps(COCO)),
        ("bom.csv", "\ufeff" + SLEAP),
    ],
)
def test_each_format_gives_the_same_lines(name: str, text: str, folder: Path, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8")
    found = taken(tmp_path / name, folder)
    assert found["img000.png"] == [[10, 20], [40, 24.5], [80, 60]]
    assert found["img002.png"] == [[10, 21], [70, 70]]
    assert len(found) == 2


def test_a_frame_without_tip_is_left_out_and_reported(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text(DLC_PREDICTIONS)
    report = import_marks(tmp_path / "p.csv", AnnotationImages(folder), AnnotationStore(folder))
    assert report.taken == 2
    assert report.remarks == ("1 images are left out, the tip is not marked (1)",)


def test_one_individual_of_a_project_for_several_is_read(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(DLC_MULTI)
    assert taken(tmp_path / "m.csv", folder) == {"img000.png": [[10, 20], [80, 60]]}


def test_a_keypoint_that_is_not_visible_is_a_hidden_tip(tmp_path: Path) -> None:
    (tmp_path / "c.json").write_text(json.dumps(COCO))
    assert [frame.tip_hidden for frame in read_marks(tmp_path / "c.json").frames] == [False, True]


@pytest.mark.parametrize("name", ["lines.csv", "lines.json"])
def test_a_written_file_is_read_again(name: str, tmp_path: Path) -> None:
    line = np.array([[10.0, 20.0], [60.0, 30.0], [90.0, 80.0]])
    frames = [
        MarkedFrame("run.mcap/3", line, tip_hidden=True, done=True),
        MarkedFrame("run.mcap/5", line + 1.0, done=True),
        MarkedFrame("run.mcap/9", np.empty((0, 2)), present=False, done=True),
    ]
    sizes = {frame.image: (320, 240) for frame in frames}
    write_marks(tmp_path / name, frames, sizes)
    again = sorted(read_marks(tmp_path / name).frames, key=lambda frame: frame.image)
    assert [(f.image, f.tip_hidden, f.present) for f in again] == [(f.image, f.tip_hidden, f.present) for f in frames]
    for old, new in zip(frames[:2], again[:2], strict=True):
        both = [frame.annotation().points_px for frame in (old, new)]
        assert np.abs(both[0] - both[1]).max() < 0.3


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.csv", "", "has no rows"),
        ("a.csv", "file,x,y\na,1,2\n", r"line 1: the header is file, x, y; expected image,u,v"),
        ("a.csv", OURS + "img002.png,5,x\n", "line 7: expected a pixel coordinate, got 'x'"),
        ("a.csv", OURS + "img002.png,5,\n", "line 7: has one coordinate of two"),
        ("a.csv", OURS + "img002.png,5,5\n", "img002.png has one row; a line needs at least two points"),
        ("a.csv", OURS + ",5,5\n", "line 7: has no name in the column image"),
        ("a.csv", OURS + "img000.png,,\n", r"line 7: img000.png has a row without u and v"),
        ("a.csv", "image,u,v,tip_hidden\na,1,2,yes\n", "line 2, column tip_hidden: expected 0 or 1, got 'yes'"),
        ("a.csv", SLEAP + "track_1,0,0.9,1,1,1,2,2,1,3,3,1\n", "line 5: frame 0 has a second instance"),
        ("a.csv", SLEAP + "track_0,x,0.9,1,1,1,2,2,1,3,3,1\n", "line 5, column frame_idx: expected the number"),
        ("a.csv", "track,frame_idx,instance.score,a.x,a.y\n,0,1,2,3\n", "has 1 nodes"),
        ("a.csv", DLC_LABELS + "labeled-data,monday,img000.png,1,1,2,2,3,3\n", "has a row already, line 4"),
        ("a.csv", DLC_LABELS.replace("10,20", "10,twenty"), "line 4, body part base: expected a pixel coordinate"),
        ("a.csv", "scorer,A,A\nbodyparts,a,a\n0,1,2\n", "no header rows bodyparts and coords"),
        ("a.csv", DLC_MULTI.replace("a,a,a,a", "a,a,b,b"), "holds the individuals a, b"),
        ("a.json", "[]", "expected an object with images and annotations"),
        ("a.json", json.dumps({**COCO, "images": []}), "image_id 7, which no image has"),
        ("a.json", json.dumps(COCO).replace("40, 24.5, 2", "40, 24.5"), "expected at least two keypoints"),
        ("a.json", json.dumps(COCO).replace("40, 24.5, 2", "40, 24.5, 3"), "a visibility is not 0, 1 or 2"),
        ("a.slp", "x", "Export Analysis CSV"),
        ("a.h5", "x", r"write a \.csv"),
    ],
)
def test_a_file_that_cannot_be_read_is_refused_in_one_sentence(
    name: str, text: str, message: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message) as refused:
        read_marks(tmp_path / name)
    assert str(tmp_path / name) in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (OURS.replace("img00", "pic00"), "none of its images is in .*pic000.png, pic001.png, there is img000.png"),
        (OURS.replace("80,60", "800,60"), r"img000.png: the point \(800, 60\) is outside of the image, 320 x 240 px"),
        (OURS.replace("40,24.5", "10,20"), "two points in a row"),
        (OURS.replace("img001.png", "0"), "mean the same image, img000.png"),
    ],
)
def test_annotations_that_do_not_fit_the_images_are_refused(
    text: str, message: str, folder: Path, tmp_path: Path
) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        taken(tmp_path / "a.csv", folder)
    assert not AnnotationStore(folder).frames


def test_annotations_of_larger_images_are_refused(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "c.json").write_text(json.dumps(COCO).replace('"width": 320', '"width": 640'))
    with pytest.raises(InputError, match="has 640 x 240 px there, the image here has 320 x 240"):
        taken(tmp_path / "c.json", folder)


def test_images_of_other_videos_are_left_out_with_a_remark(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(OURS.replace("img001.png", "other.png"))
    report = import_marks(tmp_path / "a.csv", AnnotationImages(folder), AnnotationStore(folder))
    assert report.taken == 1
    assert report.remarks == (f"1 images are not in {folder} (other.png): left out",)


def test_of_the_predictions_for_a_whole_video_evenly_spread_frames_are_taken(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tipforce.annotation._import.MAX_IMPORTED", 3)
    rows = "".join(f",{k},,10,{20 + k},,,,,80,60,\n" for k in range(14))
    (tmp_path / "s.csv").write_text(SLEAP.partition("\n")[0] + "\n" + rows)
    assert list(taken(tmp_path / "s.csv", folder)) == ["img000.png", "img006.png", "img013.png"]


@pytest.fixture
def biplane_images(tmp_path: Path) -> Path:
    for view in ("1-bca-1", "1-bca-2"):
        (tmp_path / view).mkdir()
        for k in range(2):
            grey = np.random.default_rng(k).integers(0, 255, (64, 64), np.uint8)
            cv2.imwrite(str(tmp_path / view / f"{k:03d}.png"), cv2.resize(grey, (1024, 1024)))
    return tmp_path


def guide3d(spline: bool) -> list[dict]:
    """Lines of two frames and both cameras, as Guide3D documents them; the second begins at the tip."""
    lines = {"cameraA": [[3, 590], [200, 592], [400, 560], [520, 300]], "cameraB": [[0, 790], [300, 680], [600, 320]]}
    frames = []
    for number in range(2):
        frame: dict = {"frame_number": number}
        for view, (camera, line) in enumerate(lines.items(), 1):
            points = np.array(line[::-1] if number else line, float)
            frame[camera] = {"image": f"1-bca-{view}/{number:03d}.png"}
            if spline:
                (t, c, k), u = splprep(points.T, k=min(3, len(points) - 1), s=0)
                frame[camera] |= {"tck": {"t": t.tolist(), "c": np.array(c).T.tolist(), "k": k}, "u": u.tolist()}
            else:
                frame[camera]["points"] = points.tolist()
        frames.append(frame)
    return [{"task": "1-bca", "frame_count": 2, "frames": frames}]


@pytest.mark.parametrize("spline", [False, True])
def test_guide3d_gives_the_lines_of_the_view_whose_folder_is_stated(spline: bool, biplane_images: Path) -> None:
    (biplane_images / "raw.json").write_text(json.dumps(guide3d(spline)))
    for view, base, tip in (("1-bca-1", [3, 590], [520, 300]), ("1-bca-2", [0, 790], [600, 320])):
        found = taken(biplane_images / "raw.json", biplane_images / view)
        assert sorted(found) == ["000.png", "001.png"]
        for line in found.values():
            np.testing.assert_allclose(line[0], base, atol=1e-6)
            np.testing.assert_allclose(line[-1], tip, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda camera: camera.pop("image"), "task 0, frame 1, cameraB: there is no image"),
        (lambda camera: camera.update(image="1-bca-1/000.png"), "1-bca-1/000.png is annotated twice"),
        (lambda camera: camera.pop("points"), "expected points, or a spline tck with t, c and k"),
        (lambda camera: camera.update(points=[[1, 2], [3, "x"]]), "points: expected a list of pairs of numbers"),
        (lambda camera: camera.update(points=[[1, 2], [3, float("nan")]]), "holds a value that is no number"),
    ],
)
def test_a_guide3d_file_of_another_form_is_refused(change, message: str, tmp_path: Path) -> None:
    values = guide3d(spline=False)
    change(values[0]["frames"][1]["cameraB"])
    (tmp_path / "raw.json").write_text(json.dumps(values))
    with pytest.raises(InputError, match=message):
        read_marks(tmp_path / "raw.json")


def drawn_mask(width: int = 9) -> tuple[np.ndarray, np.ndarray]:
    """A mask (240, 320) of a curved catheter, with the line that it is drawn along."""
    x = np.linspace(0, 220, 60)
    line = np.column_stack([x, 200 - 0.0026 * x**2])
    mask = np.zeros((240, 320), np.uint8)
    cv2.polylines(mask, [np.round(line).astype(np.int32)], False, 2, width)
    return mask, line


def test_masks_give_the_line_along_their_middle(folder: Path, tmp_path: Path) -> None:
    mask, line = drawn_mask()
    labels = tmp_path / "labels"
    labels.mkdir()
    cv2.imwrite(str(labels / "img000.png"), mask)
    cv2.imwrite(str(labels / "img002.png"), np.zeros_like(mask))
    report = import_marks(labels, AnnotationImages(folder), store := AnnotationStore(folder))
    assert report.remarks == ("1 images are left out, the mask is empty (img002)",)
    found = store.frames["img000.png"].points_px
    away = np.linalg.norm(found[:, None] - line[None], axis=2).min(axis=1)
    assert np.median(away[1:-1]) < 2.0  # half the distance of the line's points
    assert np.linalg.norm(found[0] - line[0]) < 5
    assert np.linalg.norm(found[-1] - line[-1]) < 5


def test_a_numbered_mask_belongs_to_the_image_of_its_number(tmp_path: Path) -> None:
    mask, _ = drawn_mask()
    for name, pixels in (("labels/mask2.png", mask), ("images/image1.jpg", mask), ("images/image2.jpg", mask)):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        cv2.imwrite(str(tmp_path / name), pixels)
    assert list(taken(tmp_path / "labels", tmp_path / "images")) == ["image2.jpg"]


def test_a_mask_of_several_parts_is_left_out(tmp_path: Path) -> None:
    mask, _ = drawn_mask()
    mask[:, 90:130] = 0
    cv2.imwrite(str(tmp_path / "a.png"), mask)
    assert read_marks(tmp_path).left_out == {"a": "the mask is in several parts"}
