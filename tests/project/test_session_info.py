"""Metadata of a session: what is stated comes back from every file, and what is wrong is named by its key."""

import math
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tipforce.datasets import Dataset, open_dataset, write_dataset
from tipforce.errors import FileFormatError, InputError
from tipforce.io import RecordingReader, RecordingWriter
from tipforce.types import (
    ActuationInfo,
    BagInfo,
    Catheter,
    ForceLogInfo,
    Frame,
    LogInfo,
    Observation,
    SensorInfo,
    SessionInfo,
    StageInfo,
    TissueInfo,
    ViewInfo,
    bench_text,
    info_from_facts,
    read_bench,
)

PROJECTION = ((1e3, 0.0, 0.0, 320.0), (0.0, -1e3, 0.0, 240.5), (0.0, 0.0, 0.0, 1.0))
LOG: dict[str, Any] = {
    "time": "Zeit [µs]",
    "date": "Datum",
    "time_unit": "us",
    "date_order": "dmy",
    "rate_hz": 1000.0,
    "columns": ("Zeit [µs]", "", "Fx"),
    "decimal_sign": ",",
    "missing": ("---",),
    "lines": (3, 900),
    "sort": True,
    "repeated_stamps": "first",
    "sheet": "Blatt 1",
}
FULL = SessionInfo(
    name="monday",
    catheter=Catheter('7F "long"', 2.33e-3, 40e-3, 8e-3, 4.3e-4, ((0.0, 1.0), (0.8, 0.5)), 0.01, 0.03, (3.0, -3.0)),
    views={
        "camera": ViewInfo(
            2.117e-4,
            "left",
            (1, 2, 30, 40),
            (0, 0, 640, 480),
            "dark",
            "camera",
            metres_per_px_uncertainty=0.006,
            tilt_uncertainty_deg=1.2,
            detector="/bench/detector",
        ),
        "second view": ViewInfo(
            modality="xray",
            projection=PROJECTION,
            projection_frame="isocentre",
            pose_uncertainty_deg=(1.0, 1.0, 0.5),
            pose_uncertainty_m=(2e-3, 0.0, 5e-3),
        ),
    },
    sensor=SensorInfo(
        angle_deg=-12.5,
        reads="tissue-on-tip",
        no_contact_s=(0.0, 5.0),
        moving_mass_kg=0.05,
        range_n=(3.0, 3.0, 9.0),
        log=ForceLogInfo(**LOG, fx="-Fy", fy="Fx", fz="Fz", status="Status", force_unit="counts", counts_per_n=1000.0),
    ),
    actuation=ActuationInfo(0.533, "knob", {"knob_deg": 10.0, "wire 1_mm": -0.25}, 0.1, 1.5, LogInfo(**LOG), 0.012),
    stage=StageInfo(LogInfo(**LOG), "camera"),
    bag=BagInfo(
        views={"camera": "/image"},
        force="/wrench",
        drives=("/joints",),
        stage=("/stage",),
        names={"/knob/data": "knob_deg"},
        receive_times=("/knob",),
    ),
    tissue=TissueInfo(120.0),
    force_frame="sensor",
    simulated=True,
    preset="bench-2021",
    remarks="kept in\nthe \\ fridge, 5 °C",
)
"""Every field stated."""

positive = st.floats(1e-4, 2e-3)
finite = st.floats(allow_nan=False, allow_infinity=False)
text = st.text(st.characters(codec="utf-8"), max_size=12)
box = st.tuples(*[st.integers(0, 9999)] * 4)
row = st.tuples(*[finite] * 4)


def maybe(values: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.none() | values


infos = st.builds(
    SessionInfo,
    name=text,
    catheter=st.builds(
        Catheter,
        name=text,
        diameter_m=maybe(positive),
        flexible_length_m=maybe(positive),
        rigid_length_m=maybe(st.just(0.0) | positive),
        bending_stiffness_nm2=maybe(positive),
        stiffness_profile=st.lists(st.tuples(st.floats(0, 1), st.floats(0.1, 10)), max_size=3, unique_by=lambda k: k[0])
        .map(sorted)
        .map(tuple),
        rest_curvature_per_m=st.just(()) | st.lists(st.floats(-200, 200), min_size=2, max_size=5).map(tuple),
    ),
    views=st.dictionaries(
        text,
        st.builds(
            ViewInfo,
            metres_per_px=maybe(positive),
            base_side=maybe(st.sampled_from(["left", "right", "top", "bottom"])),
            base_region=maybe(box),
            roi=maybe(box),
            polarity=maybe(st.sampled_from(["dark", "light"])),
            modality=maybe(st.sampled_from(["camera", "xray"])),
            projection=maybe(st.lists(row, min_size=3, max_size=3).map(tuple)),
            projection_frame=maybe(st.sampled_from(["base", "isocentre", "board"])),
            pose_uncertainty_deg=maybe(st.tuples(*[st.floats(0, 90)] * 3)),
            pose_uncertainty_m=maybe(st.tuples(*[st.floats(0, 1)] * 3)),
            detector=maybe(text.map(lambda name: f"/{name}")),
        ),
        max_size=2,
    ),
    sensor=st.builds(
        SensorInfo,
        angle_deg=maybe(st.floats(-360, 360)),
        reads=maybe(st.sampled_from(["tip-on-tissue", "tissue-on-tip"])),
        no_contact_s=maybe(st.tuples(finite, finite)),
        moving_mass_kg=maybe(positive),
        range_n=maybe(st.tuples(*[st.floats(1e-3, 1e4)] * 3)),
        log=st.builds(
            ForceLogInfo,
            time=maybe(text),
            fx=maybe(text),
            time_unit=maybe(st.sampled_from(["s", "ms", "us", "ns"])),
            force_unit=maybe(st.sampled_from(["N", "mN", "g", "counts"])),
            counts_per_n=maybe(positive),
        ),
    ),
    actuation=st.builds(
        ActuationInfo,
        knob_gain_per_m_deg=maybe(st.floats(-100, 100)),
        knob_column=maybe(text),
        constant=st.dictionaries(text, st.floats(-100, 100), max_size=2),
        knob_offset_per_m=maybe(st.floats(-200, 200)),
        knob_play_deg=maybe(st.floats(0, 90)),
    ),
    tissue=st.builds(TissueInfo, stiffness_n_per_m=maybe(st.floats(1.0, 1e5))),
    force_frame=text,
    simulated=st.booleans(),
    preset=maybe(text),
    remarks=text,
)


def known(info: SessionInfo) -> SessionInfo:
    """``info`` without the names of views of which it states nothing: a file has no place for them."""
    return replace(info, views={name: view for name, view in info.views.items() if view != ViewInfo()})


def test_every_field_of_the_full_example_is_stated() -> None:
    for part in (FULL, FULL.catheter, FULL.sensor, FULL.sensor.log, FULL.actuation, FULL.tissue, FULL.stage, FULL.bag):
        nothing = type(part)()
        assert not [each.name for each in fields(part) if getattr(part, each.name) == getattr(nothing, each.name)]
    stated = [{f.name for f in fields(view) if getattr(view, f.name) is not None} for view in FULL.views.values()]
    assert set.union(*stated) == {each.name for each in fields(ViewInfo)}


@pytest.mark.parametrize("guide", [True, False])
def test_all_that_a_bench_file_states_comes_back(tmp_path: Path, guide: bool) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(bench_text(FULL, guide=guide), encoding="utf-8")
    assert read_bench(path) == replace(FULL, name="")


@given(infos, st.booleans())
def test_any_metadata_come_back_from_a_bench_file(
    tmp_path_factory: pytest.TempPathFactory, info: SessionInfo, guide: bool
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.toml"
    path.write_text(bench_text(info, guide=guide), encoding="utf-8", newline="")
    assert known(read_bench(path)) == known(replace(info, name=""))


@given(infos)
def test_values_are_turned_back_into_the_same_metadata(info: SessionInfo) -> None:
    assert known(SessionInfo.from_values(info.values())) == known(info)


def test_a_recording_carries_every_field(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "run.mcap", FULL) as writer:
        writer.write(Frame(0, np.zeros((8, 8), np.uint8)))
    with RecordingReader(tmp_path / "run.mcap") as reader:
        assert reader.session_info == FULL


class Grey:
    """A store of grey images."""

    def read(self, rows: np.ndarray) -> Iterator[Observation]:
        for row in rows.tolist():
            yield Observation(row, {"camera": np.full((8, 8), row, np.uint8)})


def test_a_dataset_folder_carries_every_field(tmp_path: Path) -> None:
    other = replace(FULL, name="tuesday", catheter=replace(FULL.catheter, diameter_m=2e-3), remarks="")
    data = Dataset(
        store=Grey(),
        session=np.array(["monday", "monday", "tuesday"]),
        stamp_ns=np.arange(3),
        actuation={},
        force_n=np.zeros((3, 3)),
        known=np.ones(3, np.bool_),
        names=np.arange(3).astype(str),
        session_info={"monday": FULL, "tuesday": other},
        rows=np.arange(3),
    )
    again = open_dataset(write_dataset(data, tmp_path / "data"))
    assert dict(again.session_info) == {"monday": FULL, "tuesday": other}
    assert cv2.imread(str(tmp_path / "data" / str(again.names[2])), cv2.IMREAD_UNCHANGED)[0, 0] == 2


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("colour = 1", "colour is not known; it may hold name, catheter, views, sensor"),
        ("[catheter]\nlength_m = 0.04", "catheter.length_m is not known; catheter may hold name, diameter_m"),
        ("[views.camera]\nbase = 'left'", "views.camera.base is not known; views.camera may hold metres_per_px, base_"),
        (
            "[sensor.log]\nunit = 'N'",
            "sensor.log.unit is not known; sensor.log may hold time, date, time_unit, date_order",
        ),
        ("[sensor]\nangle = 3", "sensor.angle is not known; sensor may hold angle_deg, reads"),
        ("[actuation]\nknob_deg = 3", "actuation.knob_deg is not known; actuation may hold knob_gain_per_m_deg"),
        (
            "[views.camera]\nbase_side = 'up'",
            "views.camera.base_side = 'up' is refused: input should be 'left',",
        ),
        ("[sensor]\nreads = 'both'", "sensor.reads = 'both' is refused: input should be 'tip-on-tissue' or"),
        ("[catheter]\ndiameter_m = 2.33", "it is in metres: for 2.33 mm write 0.00233"),
        ("[catheter]\nflexible_length_m = 40", "it is in metres: for 40 mm write 0.04"),
        ("[catheter]\nbending_stiffness_uncertainty = 3", "it is in shares: for 3 % write 0.03"),
        ("[views.camera]\nmetres_per_px = 0.21", "it is in metres: for 0.21 mm write 0.00021"),
        ("[catheter]\ndiameter_m = -1", "catheter.diameter_m = -1 is refused: expected 5e-05 to 0.05 metres"),
        (
            "[catheter]\nrest_curvature_per_m = [3.0]",
            "rest_curvature_per_m = [3.0] is refused: tuple should have at least 2",
        ),
        ("[catheter]\nrest_curvature_per_m = [3.0, 500.0]", "= 500.0 is refused: expected -200 to 200 1/m"),
        (
            "[catheter]\nstiffness_profile = [[0.5, 1.0], [0.2, 1.0]]",
            "stiffness_profile is refused: expected shares of the length that grow from base to tip, got 0.5, 0.2",
        ),
        ("[sensor]\nangle_deg = nan", "sensor.angle_deg = nan is refused: input should be a finite number"),
        ("[catheter]\nbending_stiffness_nm2 = 430", "it is in N m^2: for 430 N mm^2 write 0.00043"),
        ("[views.camera]\nmetres_per_px = 1", "is refused: expected 1e-08 to 0.01 metres"),
        ("[actuation]\nknob_gain_per_m_deg = 1e9", "is refused: expected -100 to 100"),
        ("[sensor]\nangle_deg = 1000", "is refused: expected -360 to 360 degrees"),
        ("[actuation.constant]\nknob_deg = 1000.0", "knob_deg = 1000 is refused: expected -720 to 720 degrees"),
        ("[actuation.constant]\nknob_deg = 'ten'", "actuation.constant.knob_deg = 'ten' is refused"),
        ("[sensor]\nno_contact_s = [0]", "sensor.no_contact_s"),
        ("[sensor]\nrange_n = [3.0, 3.0, 0.0]", "sensor.range_n = 0.0 is refused: expected 0.001 to 10000 N"),
        ("[sensor]\nrange_n = 3.0", "sensor.range_n = 3.0 is refused: input should be a valid tuple"),
        ("[tissue]\nstiffness_n_per_m = 0.12", "it is in N/m: for 0.12 N/mm write 120"),
        ("catheter = 3", "catheter = 3 is refused"),
    ],
)
def test_what_is_wrong_in_a_bench_file_is_named_with_file_and_key(tmp_path: Path, content: str, said: str) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(content)
    with pytest.raises(InputError) as caught:
        read_bench(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"[catheter\n", "is no TOML"),
        (b"name = \xff", "is no text in UTF-8"),
        (None, "does not exist; write one with `tipforce init-bench -o "),
    ],
)
def test_what_is_no_bench_file_is_called_so(tmp_path: Path, content: bytes | None, said: str) -> None:
    path = tmp_path / "bench.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(FileFormatError) as caught:
        read_bench(path)
    assert str(caught.value).startswith(f"{path}: {said}")
    with pytest.raises(FileFormatError, match="is a folder"):
        read_bench(tmp_path)


def test_a_bench_file_of_an_editor_on_windows_is_read(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_bytes('[catheter]\r\nname = "Prüfling"\r\n'.encode("utf-8-sig"))
    assert read_bench(path).catheter.name == "Prüfling"


def test_single_facts_are_typed_as_toml_or_as_bare_words() -> None:
    facts = ["views.camera.base_side=left", "catheter.diameter_m = 2.33e-3", "sensor.no_contact_s=[0, 5]"]
    facts += ["views.camera.metres_per_px=2e-4", 'catheter.name="7F"', "actuation.constant.knob_deg=10"]
    assert info_from_facts(facts) == SessionInfo(
        catheter=Catheter("7F", 2.33e-3),
        views={"camera": ViewInfo(2e-4, "left")},
        sensor=SensorInfo(no_contact_s=(0.0, 5.0)),
        actuation=ActuationInfo(constant={"knob_deg": 10.0}),
    )
    assert info_from_facts(["catheter.name=a", "catheter.name=b"]).catheter.name == "b"
    for bad in ("left", "=left", "views.camera.base_side="):
        with pytest.raises(InputError, match="expected KEY=VALUE, for example"):
            info_from_facts([bad])
    with pytest.raises(InputError, match=r"fact catheter\.size=3: catheter\.size is not known"):
        info_from_facts(["catheter.size=3"])


def test_what_is_stated_stands_in_place_of_what_was_known_and_leaves_the_rest() -> None:
    stated = SessionInfo(
        catheter=Catheter(diameter_m=1e-3),
        views={"camera": ViewInfo(base_side="top"), "third": ViewInfo(1e-4)},
        sensor=SensorInfo(log=ForceLogInfo(fz="Fw")),
        actuation=ActuationInfo(constant={"knob_deg": 3.0}),
    )
    found = FULL.updated(stated)
    assert found.name == "monday"
    assert found.catheter == replace(FULL.catheter, diameter_m=1e-3)
    assert found.views == {
        **FULL.views,
        "camera": replace(FULL.views["camera"], base_side="top"),
        "third": ViewInfo(1e-4),
    }
    assert found.sensor == replace(FULL.sensor, log=replace(FULL.sensor.log, fz="Fw"))
    assert dict(found.actuation.constant) == {"knob_deg": 3.0, "wire 1_mm": -0.25}
    assert (found.force_frame, found.simulated, found.preset) == ("sensor", True, "bench-2021")
    assert SessionInfo().updated(FULL) == FULL.updated(FULL) == FULL.updated(SessionInfo()) == FULL


def test_keys_of_what_is_stated_are_those_of_the_file() -> None:
    keys = set(FULL.stated_keys())
    assert {
        "catheter.diameter_m",
        "views.camera.metres_per_px",
        "views.second view.projection",
        "sensor.angle_deg",
        "sensor.log.counts_per_n",
        "actuation.knob_gain_per_m_deg",
        "actuation.constant.knob_deg",
        "tissue.stiffness_n_per_m",
    } <= keys
    assert not keys & {"name", "catheter.name", "force_frame", "simulated", "preset", "remarks"}
    assert SessionInfo("a", Catheter("7F")).stated_keys() == ()


def test_what_a_method_never_saw_can_be_taken_away() -> None:
    keys = ("catheter.flexible_length_m", "views.camera.base_side", "sensor.angle_deg")
    found = FULL.only(keys)
    assert found.stated_keys() == keys
    assert found.catheter == Catheter(FULL.catheter.name, flexible_length_m=40e-3)
    assert found.view("camera") == ViewInfo(base_side="left")
    assert found.view("second view") == found.view("no such view") == ViewInfo()
    assert (found.name, found.force_frame, found.simulated) == (FULL.name, "sensor", True)
    assert FULL.only(FULL.stated_keys()) == FULL
    assert FULL.only([]).stated_keys() == ()
    assert len(FULL.stated_keys()) > 20  # the original keeps what it states


def test_what_a_method_needs_and_nobody_stated_is_told_in_its_order() -> None:
    bare = SessionInfo(catheter=Catheter(rigid_length_m=0.0), views={"camera": ViewInfo(2e-4)})
    needed = ("views.camera.base_side", "catheter.rigid_length_m", "views.camera.metres_per_px", "sensor.reads")
    assert bare.missing(needed) == ("views.camera.base_side", "sensor.reads")
    assert FULL.missing(needed) == ()
    assert SessionInfo().missing(needed) == needed


def test_a_sensor_without_a_stated_pose_counts_as_under_the_tissue_along_the_base() -> None:
    assert np.array_equal(SensorInfo().matrix, -np.eye(3))
    assert np.array_equal(SensorInfo(reads="tissue-on-tip").matrix, np.eye(3))
    turned = SensorInfo(30.0, "tissue-on-tip").matrix @ [1.0, 0.0, 0.0]
    np.testing.assert_allclose(turned, [math.cos(math.pi / 6), 0.5, 0.0])


@pytest.mark.parametrize("name", ["roi", "base_region"])
def test_a_box_beyond_all_images_is_refused_by_its_name(name: str) -> None:
    with pytest.raises(InputError, match=rf"views\.camera\.{name}"):
        SessionInfo.from_values({"views": {"camera": {name: [0, 0, 2**63, 5]}}})
