"""Sets that grow session by session: whole or not at all, the same bytes in any order, as images or shards."""

import contextlib
import json
import random
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from tipforce.datasets import (
    Dataset,
    Growing,
    GrowingImages,
    GrowingShards,
    SessionSamples,
    open_dataset,
    write_dataset,
)
from tipforce.errors import FileFormatError, InputError
from tipforce.types import ActuationInfo, Catheter, SensorInfo, SessionInfo, ViewInfo

SESSIONS, EACH = 5, 4


def make_images(folder: Path) -> Growing:
    return GrowingImages(folder, SESSIONS)


def make_shards(folder: Path) -> Growing:
    pytest.importorskip("pyarrow")
    return GrowingShards(folder, SESSIONS, 1000)  # two sessions a shard


def png(level: int) -> bytes:
    return cv2.imencode(".png", np.full((6, 8), level, np.uint8))[1].tobytes()


def samples(number: int, views: tuple[str, ...] = ("camera",), masks: bool = False) -> SessionSamples:
    catheter = Catheter("7F", flexible_length_m=0.04 + 1e-3 * number, bending_stiffness_nm2=4.3e-4)
    frame = np.arange(EACH) * 7 + number
    return SessionSamples(
        session_info=SessionInfo(
            f"s{number}",
            catheter,
            {"camera": ViewInfo(round(2e-4 + 1e-6 * number, 8), "left")},
            SensorInfo(float(number)),
            ActuationInfo(constant={"wire_mm": 1.5}),
        ),
        frame=frame,
        stamp_ns=frame * 41_666_667,
        actuation={"knob_deg": np.linspace(0.1, 0.7, EACH)},
        force_n=np.outer(np.arange(EACH) / 3, [1.0, -0.5, 0.1]),
        known=np.ones(3, np.bool_),
        images={view: [png(40 * place + 8 * number + k) for k in range(EACH)] for place, view in enumerate(views)},
        suffix=".png",
        masks={view: [png(255 - place)] * EACH for place, view in enumerate(views)} if masks else {},
    )


def grow(into: Growing, order: list[int], **kinds: object) -> Dataset:
    for number in order:
        into.add(number, samples(number, **kinds))  # type: ignore[arg-type]
    into.finish("grown")
    return open_dataset(into.folder)


def content(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


both = pytest.mark.parametrize("make", [make_images, make_shards])


@both
def test_what_is_added_is_what_opens_with_the_facts_of_each_session(
    make: Callable[[Path], Growing], tmp_path: Path
) -> None:
    data = grow(make(tmp_path), list(range(SESSIONS)))
    assert (len(data), data.title) == (SESSIONS * EACH, "grown")
    assert data.sessions == tuple(f"s{number}" for number in range(SESSIONS))
    for number in range(SESSIONS):
        given = samples(number)
        rows = data.session == f"s{number}"
        assert data.session_info[f"s{number}"] == given.session_info
        assert np.array_equal(data.force_n[rows], given.force_n)
        assert np.array_equal(data.stamp_ns[rows], given.stamp_ns)
        assert np.array_equal(data.actuation["knob_deg"][rows], given.actuation["knob_deg"])
    levels = [int(each.views["camera"][0, 0]) for each in data.observations()]  # type: ignore[index]
    assert levels == [8 * number + k for number in range(SESSIONS) for k in range(EACH)]
    assert data.names[0] == "images/s0/00000.png"
    mixed = data.subset(np.array([17, 2, 9])).observations()
    assert [int(each.views["camera"][0, 0]) for each in mixed] == [33, 2, 17]  # type: ignore[index]


@both
def test_the_order_of_adding_changes_no_byte(make: Callable[[Path], Growing], tmp_path: Path) -> None:
    grow(make(tmp_path / "a"), list(range(SESSIONS)))
    grow(make(tmp_path / "b"), [3, 0, 4, 1, 2])
    assert content(tmp_path / "a") == content(tmp_path / "b")


@both
def test_two_views_are_two_columns(make: Callable[[Path], Growing], tmp_path: Path) -> None:
    data = grow(make(tmp_path), list(range(SESSIONS)), views=("a", "b"))
    first = next(data.observations())
    assert {name: int(view[0, 0]) for name, view in first.views.items()} == {"a": 0, "b": 40}  # type: ignore[index]
    again = open_dataset(write_dataset(data, tmp_path / "copy"))
    assert again.fingerprint() == data.fingerprint()
    assert dict(again.session_info) == dict(data.session_info)
    for one, other in zip(data.observations(), again.observations(), strict=True):
        assert all(np.array_equal(one.views[view], other.views[view]) for view in ("a", "b"))  # type: ignore[arg-type]


@both
def test_a_set_goes_on_where_it_was_cut_off(make: Callable[[Path], Growing], tmp_path: Path) -> None:
    grow(make(tmp_path / "whole"), list(range(SESSIONS)))
    first = make(tmp_path / "cut")
    first.add(0, samples(0))
    first.add(3, samples(3))
    (first.parts / "images-s1").mkdir()  # what a kill leaves of a session
    (first.parts / "images-s1" / "00001.png").write_bytes(b"half")
    (first.parts / "0000001.part").write_bytes(b"half")
    (tmp_path / "cut" / "images" / "s2").mkdir(parents=True, exist_ok=True)
    (tmp_path / "cut" / "images" / "s2" / "99999.png").write_bytes(b"images whose rows were not written")
    second = make(tmp_path / "cut")
    assert not second.whole
    todo = [number for number in range(SESSIONS) if not second.has(number)]
    assert todo == [1, 2, 4]
    grow(second, todo)
    assert make(tmp_path / "cut").whole
    (tmp_path / "cut" / "images" / "s2" / "99999.png").unlink(missing_ok=True)  # shards know nothing of it
    assert content(tmp_path / "cut") == content(tmp_path / "whole")


@pytest.mark.parametrize("content", [b"{", b"[" * 100_000, b"[]", b'{"view": "camera"}', b"\xff"])
def test_a_damaged_note_of_a_session_says_how_to_go_on(tmp_path: Path, content: bytes) -> None:
    growing = GrowingImages(tmp_path, SESSIONS)
    growing.add(0, samples(0))
    (note,) = growing.parts.glob("*.json")
    note.write_bytes(content)
    with pytest.raises(FileFormatError, match=f"^{re.escape(str(note))}: .*the same command makes its session again$"):
        GrowingImages(tmp_path, SESSIONS).view()


@both
@pytest.mark.parametrize("after", [0, 1, 2, 3])
def test_gathering_that_was_cut_off_is_begun_again(
    make: Callable[[Path], Growing], after: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A kill just before the ``after``-th file takes its final name."""
    grow(make(tmp_path / "whole"), list(range(SESSIONS)))
    into = make(tmp_path / "cut")
    for number in range(SESSIONS):
        into.add(number, samples(number))
    real, count = Path.replace, 0

    def replace(self: Path, target: Path) -> Path:
        nonlocal count
        if target.parent == into.folder:
            if count == after:
                raise KeyboardInterrupt
            count += 1
        return real(self, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", replace)
        try:
            into.finish("grown")
        except KeyboardInterrupt:
            assert not make(tmp_path / "cut").whole
    again = make(tmp_path / "cut")
    if not again.whole:
        assert all(again.has(number) for number in range(SESSIONS))
        again.finish("grown")
    assert content(tmp_path / "cut") == content(tmp_path / "whole")


def test_masks_lie_beside_the_images_under_the_same_names(tmp_path: Path) -> None:
    data = grow(make_images(tmp_path), list(range(SESSIONS)), masks=True)
    for name in data.names.tolist():
        assert (tmp_path / name.replace("images", "masks", 1)).is_file()
    assert "masks" not in (tmp_path / "metadata.csv").read_text()


def test_every_view_has_masks_of_its_own(tmp_path: Path) -> None:
    grow(make_images(tmp_path), list(range(SESSIONS)), views=("a", "b"), masks=True)
    shown = {path.relative_to(tmp_path / "images").with_suffix("") for path in (tmp_path / "images").rglob("*.png")}
    masks = {path.relative_to(tmp_path / "masks").with_suffix("") for path in (tmp_path / "masks").rglob("*.png")}
    assert shown == masks
    assert len(masks) == 2 * SESSIONS * EACH
    assert next((tmp_path / "masks").rglob("*-a.png")).read_bytes() == png(255)
    assert next((tmp_path / "masks").rglob("*-b.png")).read_bytes() == png(254)


def test_facts_that_all_sessions_share_are_stated_once(tmp_path: Path) -> None:
    grow(make_images(tmp_path), list(range(SESSIONS)))
    facts = json.loads((tmp_path / "dataset.json").read_text())
    assert facts["catheter"] == {"name": "7F", "bending_stiffness_nm2": 4.3e-4}
    assert facts["views"] == {"camera": {"base_side": "left"}}
    assert facts["actuation"] == {"constant": {"wire_mm": 1.5}}
    assert facts["sessions"]["s2"] == {
        "catheter": {"flexible_length_m": 0.042},
        "views": {"camera": {"metres_per_px": 2.02e-4}},
        "sensor": {"angle_deg": 2.0},
    }


@both
def test_no_flipped_bit_of_an_image_or_a_label_in_shards_is_overlooked(
    make: Callable[[Path], Growing], tmp_path: Path
) -> None:
    data = grow(make(tmp_path), list(range(SESSIONS)))
    whole = data.fingerprint(), [each.views["camera"].tobytes() for each in data.observations()]  # type: ignore[union-attr]
    chance = random.Random(0)
    path = sorted([*tmp_path.glob("*.parquet"), *tmp_path.glob("images/s0/*")])[0]
    raw = path.read_bytes()
    for place in chance.sample(range(len(raw)), 40):
        hurt = bytearray(raw)
        hurt[place] ^= 1 << chance.randrange(8)
        path.write_bytes(hurt)
        read = None
        with contextlib.suppress(InputError):
            again = open_dataset(tmp_path)
            read = again.fingerprint(), [each.views["camera"].tobytes() for each in again.observations()]  # type: ignore[union-attr]
        assert read in (None, whole)
        assert read is None or path.suffix == ".parquet"  # of a page's head some bytes say nothing that is used


def test_missing_foreign_and_cut_off_shards_are_named(tmp_path: Path) -> None:
    grow(make_shards(tmp_path), list(range(SESSIONS)))
    last, first = tmp_path / "samples-00002-of-00003.parquet", tmp_path / "samples-00000-of-00003.parquet"
    raw = last.read_bytes()
    shutil.copy(first, tmp_path / "more.parquet")
    with pytest.raises(FileFormatError, match=r"more\.parquet: is not a shard that"):
        open_dataset(tmp_path)
    (tmp_path / "more.parquet").unlink()
    last.unlink()
    with pytest.raises(FileFormatError, match=r"samples-00002-of-00003\.parquet: the shard is missing"):
        open_dataset(tmp_path)
    (tmp_path / "dataset.json").unlink()  # also by the names of the others
    with pytest.raises(FileFormatError, match=r"samples-00002-of-00003\.parquet: the shard is missing"):
        open_dataset(tmp_path)
    last.write_bytes(raw[:-100])
    with pytest.raises(FileFormatError, match=r"samples-00002-of-00003\.parquet"):
        open_dataset(tmp_path)
