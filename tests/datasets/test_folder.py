"""The dataset folder: read, written, and refused with a reason."""

import json
import os
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tipforce.datasets import Dataset, open_dataset, write_dataset
from tipforce.errors import FileFormatError, InputError, TableError, TimeError
from tipforce.types import Catheter, SessionInfo, ShapeFeatures, ViewInfo

Make = Callable[..., Path]


def test_a_folder_made_by_hand_opens(make_folder: Make) -> None:
    data = open_dataset(make_folder())
    assert len(data) == 24
    assert data.sessions == ("s0", "s1", "s2")
    assert data.known.tolist() == [True, True, False]
    assert np.isnan(data.force_n[:, 2]).all()
    first, last = data.subset(np.array([0])), data.subset(np.array([23]))
    observation = next(first.observations())
    assert observation.stamp_ns == 1_700_000_000_000_000_001  # not through a float
    assert dict(observation.actuation) == {"knob_deg": 10.0}
    view = next(last.observations()).views["camera"]
    assert isinstance(view, np.ndarray)
    assert view.shape == (12, 16)
    assert view[0, 0] == 27


def test_rows_come_in_the_order_of_sessions_and_stamps(make_folder: Make) -> None:
    data = open_dataset(make_folder(change=lambda rows: rows.reverse()))
    assert data.sessions == ("s2", "s1", "s0")
    for name in data.sessions:
        assert np.all(np.diff(data.stamp_ns[data.session == name]) > 0)
    values = [int(o.views["camera"][0, 0]) for o in data.observations()]  # type: ignore[index]
    assert values == [*range(20, 28), *range(10, 18), *range(8)]


def test_common_facts_reach_every_session(make_folder: Make) -> None:
    folder = make_folder()
    facts = {
        "force_frame": "sensor",
        "views": {"camera": {"metres_per_px": 1e-4, "base_side": "left"}},
        "catheter": {"name": "X", "diameter_m": 0.002},
    }
    own = {"s1": {"remarks": "soft wall", "catheter": {"diameter_m": 0.003}}}
    (folder / "dataset.json").write_text(json.dumps({**facts, "sessions": own}))
    infos = open_dataset(folder).session_info
    shared = SessionInfo("s0", Catheter("X", 0.002), {"camera": ViewInfo(1e-4, "left")}, force_frame="sensor")
    assert infos["s0"] == shared
    assert infos["s1"] == replace(shared, name="s1", catheter=Catheter("X", 0.003), remarks="soft wall")


def same(a: Dataset, b: Dataset) -> bool:
    return a.fingerprint() == b.fingerprint() and dict(a.session_info) == dict(b.session_info) and a.title == b.title


def test_masks_stand_beside_the_images_and_are_no_part_of_an_observation(make_folder: Make) -> None:
    folder = make_folder(sessions=1, frames=2)
    (folder / "masks").mkdir()
    drawn = np.zeros((12, 16), np.uint8)
    drawn[6] = 255
    (folder / "masks" / "0_1.png").write_bytes(cv2.imencode(".png", drawn)[1].tobytes())
    data = open_dataset(folder)
    first, second = data.masks("camera")
    assert first is None
    assert np.array_equal(second, drawn)  # type: ignore[arg-type]
    assert not data.has_masks("camera")
    assert data.subset(np.array([1])).has_masks("camera")
    assert all(set(each.views) == {"camera"} for each in data.observations())


def test_what_is_written_reads_back_the_same(make_folder: Make, tmp_path: Path) -> None:
    data = open_dataset(make_folder())
    again = open_dataset(write_dataset(data, tmp_path / "copy"))
    assert same(data, again)
    for a, b in zip(data.observations(), again.observations(), strict=True):
        assert np.array_equal(a.views["camera"], b.views["camera"])  # type: ignore[arg-type]


def test_shape_columns_stand_for_images(tmp_path: Path) -> None:
    folder = tmp_path / "shapes"
    folder.mkdir()
    (folder / "metadata.csv").write_text("shape_A1,shape_A2,stamp_ns,fx_n,note_who\n0.5,1e-3,5,0.25,me\n1,2,6,0.5,\n")
    data = open_dataset(folder)
    view = next(data.observations()).views["camera"]
    assert isinstance(view, ShapeFeatures)
    assert view.names == ("A1", "A2")
    assert view.values.tolist() == [0.5, 0.001]
    assert data.sessions == ("shapes",)
    assert dict(data.actuation) == {}
    again = open_dataset(write_dataset(data, tmp_path / "again"))
    assert data.fingerprint() == again.fingerprint()


def test_an_existing_folder_is_kept_unless_told_otherwise(make_folder: Make, tmp_path: Path) -> None:
    data = open_dataset(make_folder())
    target = write_dataset(data.subset(np.arange(4)), tmp_path / "copy")
    with pytest.raises(InputError, match="exists already"):
        write_dataset(data, target)
    assert len(open_dataset(target)) == 4
    write_dataset(data, target, overwrite=True)
    assert len(open_dataset(target)) == 24


def test_a_folder_with_anything_else_in_it_is_never_replaced(make_folder: Make, tmp_path: Path) -> None:
    data = open_dataset(make_folder())
    target = write_dataset(data.subset(np.arange(4)), tmp_path / "copy")
    (target / "notes.txt").write_text("precious")
    with pytest.raises(InputError, match=r"holds 'notes\.txt', which is no part of a dataset folder"):
        write_dataset(data, target, overwrite=True)
    assert (target / "notes.txt").read_text() == "precious"
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="does not replace it"):
        write_dataset(data, tmp_path / "file", overwrite=True)


def test_a_failure_while_writing_leaves_nothing_and_keeps_the_old(make_folder: Make, tmp_path: Path) -> None:
    folder = make_folder()
    data = open_dataset(folder)
    target = write_dataset(data.subset(np.arange(4)), tmp_path / "copy")
    os.remove(folder / "images" / "1_3.png")
    with pytest.raises(FileFormatError, match=r"1_3\.png"):
        write_dataset(data, target, overwrite=True)
    assert len(open_dataset(target)) == 4
    assert sorted(path.name for path in tmp_path.iterdir()) == ["copy", "data"]


Rows = list[dict[str, object]]


def put(row: int, column: str, value: object) -> Callable[[Rows], None]:
    return lambda rows: rows[row].__setitem__(column, value)


def drop(column: str) -> Callable[[Rows], None]:
    def change(rows: Rows) -> None:
        for row in rows:
            del row[column]

    return change


def rename(old: str, new: str) -> Callable[[Rows], None]:
    def change(rows: Rows) -> None:
        for row in rows:
            row[new] = row.pop(old)

    return change


@pytest.mark.parametrize(
    ("change", "kind", "message"),
    [
        (put(3, "fx_n", "abc"), TableError, r"metadata\.csv, line 5, column fx_n: expected a number, got 'abc'"),
        (put(3, "fx_n", "nan"), TableError, r"line 5, column fx_n"),
        (put(0, "fx_n", "0,25"), TableError, r"line 2, column fx_n.*has a decimal comma"),
        (put(2, "stamp_ns", "1.5"), TableError, r"line 4, column stamp_ns: expected a whole number, got '1\.5'"),
        (put(2, "session", ""), TableError, r"line 4, column session: is empty"),
        (put(1, "stamp_ns", 1_700_000_000_000_000_001), TimeError, r"session s0 has two samples with the stamp 17"),
        (put(1, "file_name", "images/no.png"), FileFormatError, r"line 3: there is no image .*no\.png"),
        (rename("fx_n", "fx_mn"), TableError, r"'fx_mn' is a force, and forces are read in newtons"),
        (drop("file_name"), TableError, r"either a column file_name or columns shape_NAME"),
        (lambda rows: [drop(c)(rows) for c in ("fx_n", "fy_n")], TableError, r"no force column"),
        (rename("knob_deg", "knob"), TableError, r"'knob' does not state its unit"),
    ],
)
def test_a_table_that_cannot_be_used_is_one_clear_sentence(
    make_folder: Make, change: Callable[[Rows], None], kind: type[Exception], message: str
) -> None:
    with pytest.raises(kind, match=message):
        open_dataset(make_folder(change=change))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("file_name,stamp_ns,fx_n\n", "no rows"),
        ("file_name,stamp_ns,fx_n\na.png,1,0,25\n", r"line 2: has 4 cells for 3 columns: commas seem to be both"),
        ("file_name,stamp_ns,fx_n,fx_n\na.png,1,0,2\n", "appears twice"),
    ],
)
def test_a_damaged_table_is_one_clear_sentence(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "metadata.csv").write_text(text)
    with pytest.raises((TableError, FileFormatError), match=message):
        open_dataset(tmp_path)


@pytest.mark.parametrize(
    ("change", "encoding"),
    [
        (lambda text: text, "utf-8-sig"),
        (lambda text: text.replace("\n", ",,,\n"), "utf-8"),
        (lambda text: text.replace("\n", ",\n", 1), "utf-8"),
        (lambda text: re.sub(r"(\d)\.(\d)", r"\1,\2", text.replace(",", ";")), "utf-8"),
        (lambda text: text.replace(",", "\t"), "utf-16"),
    ],
    ids=["byte order mark", "trailing empty columns", "header one longer", "decimal comma", "as Excel's Unicode text"],
)
def test_a_table_as_spreadsheets_write_it_is_the_same_table(
    make_folder: Make, change: Callable[[str], str], encoding: str
) -> None:
    folder = make_folder()
    plain = open_dataset(folder)
    text = (folder / "metadata.csv").read_text()
    (folder / "metadata.csv").write_text(change(text), encoding=encoding)
    assert same(open_dataset(folder), plain)


def test_still_images_without_stamps_are_a_second_apart_in_each_session(make_folder: Make) -> None:
    data = open_dataset(make_folder(change=drop("stamp_ns")))
    for name in data.sessions:
        stamps = data.stamp_ns[data.session == name]
        assert stamps.tolist() == [k * 1_000_000_000 for k in range(len(stamps))]


def test_a_damaged_image_names_its_file(make_folder: Make) -> None:
    folder = make_folder()
    data = open_dataset(folder)
    (folder / "images" / "0_2.png").write_bytes(b"\x89PNG\r\n")
    with pytest.raises(FileFormatError, match=r"0_2\.png: the image is missing, empty or damaged"):
        list(data.observations())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is no JSON"),
        ('{"scale": 1}', "scale is not known; it may hold title"),
        ('{"title": 1}', "title and view must be text"),
        ('{"title": "/dev/zero"}', "title is '/dev/zero', expected a name .*and no path; correct it there"),
        ('{"view": "\\u001b[2J"}', "view is .*, expected a name in up to"),
        ('{"sessions": {"s1": 1}}', "sessions must be an object"),
        ('{"catheter": {"length_m": 1}}', r"dataset\.json: catheter\.length_m is not known; catheter may hold name"),
        (
            '{"sessions": {"s1": {"views": {"camera": {"base_side": "up"}}}}}',
            r"dataset\.json: views\.camera\.base_side = 'up' is refused: .*'left'",
        ),
    ],
)
def test_wrong_facts_are_one_clear_sentence(make_folder: Make, text: str, message: str) -> None:
    folder = make_folder()
    (folder / "dataset.json").write_text(text)
    with pytest.raises(InputError, match=message):
        open_dataset(folder)


def test_what_is_no_dataset_says_what_is_expected(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="there is no such file or folder"):
        open_dataset(tmp_path / "nowhere")
    with pytest.raises(FileFormatError, match=r"holds no samples; expected metadata\.csv"):
        open_dataset(tmp_path)
    (tmp_path / "video.mp4").write_bytes(b"x")
    with pytest.raises(FileFormatError, match="tipforce import"):
        open_dataset(tmp_path / "video.mp4")


@pytest.mark.parametrize(
    "name", ["../outside.png", "images/../../outside.png", "ABSOLUTE", "images/link.png", "out/a.png"]
)
def test_images_outside_of_the_folder_are_refused(make_folder: Callable[..., Path], name: str) -> None:
    folder = make_folder(sessions=1)
    (folder.parent / "others").mkdir()
    for outside in (folder.parent / "outside.png", folder.parent / "others/a.png"):
        outside.write_bytes((folder / "images/0_0.png").read_bytes())
    (folder / "images/link.png").symlink_to(folder.parent / "others/a.png")
    (folder / "out").symlink_to(folder.parent / "others")
    table = folder / "metadata.csv"
    stated = str(folder.parent / "others/a.png") if name == "ABSOLUTE" else name
    table.write_text(table.read_text().replace("images/0_1.png", stated))
    with pytest.raises(FileFormatError, match=r"line 3: .* is outside of "):
        open_dataset(folder)


def test_links_that_lead_nowhere_or_round_are_missing_images(make_folder: Callable[..., Path]) -> None:
    folder = make_folder(sessions=1)
    (folder / "images/0_1.png").unlink()
    (folder / "images/0_1.png").symlink_to("0_1.png")
    with pytest.raises(FileFormatError, match="line 3: there is no image"):
        open_dataset(folder)
