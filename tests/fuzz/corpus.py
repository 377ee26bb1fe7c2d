"""Good files of every kind, small, made by the program itself: what the cases of the suite are made from."""

import importlib.util
import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from scipy.io import savemat

from tipforce.datasets import open_dataset, write_dataset
from tipforce.estimators import create, save_model
from tipforce.estimators.store._pretrained import pretrained_folder
from tipforce.geometry import curve_from_angle
from tipforce.io import RecordingWriter, open_source, write_video
from tipforce.types import (
    Actuation,
    ActuationInfo,
    BasePose,
    Catheter,
    Frame,
    SensorInfo,
    SessionInfo,
    ViewInfo,
    Wrench,
    bench_text,
)

__all__ = ["FRAMES", "make_corpus"]

FRAMES = 24
"""Of each kind of data; the least that svr is trained on is 20."""
STEP_NS = 40_000_000
INFO = SessionInfo(
    name="run",
    catheter=Catheter("9F", 3.2e-3, 40e-3, 8e-3, 4e-4, ((0.0, 1.0), (1.0, 0.5))),
    views={"camera": ViewInfo(4.6e-4, "left", None, (0, 0, 160, 120), "dark", "camera")},
    sensor=SensorInfo(90.0, "tip-on-tissue", (0.0, 0.2), 0.0),
    actuation=ActuationInfo(0.5, None, {"knob_deg": 10.0}),
    remarks="made for the fuzz suite",
)


def _bend(k: int) -> float:
    return 0.8 + 0.5 * float(np.sin(0.55 * k))


def _image(k: int) -> np.ndarray:
    """(120, 160) grey: a dark tube from the left."""
    axis = BasePose(np.array([-10.0, 75.0]), -0.02).to_image(
        curve_from_angle(np.array([0.4, 0.5, 0.1]) * _bend(k), 110.0, 100)
    )
    image = np.full((120, 160), 215, np.uint8)
    cv2.polylines(image, [np.round(axis * 16).astype(np.int32)], False, 45, 7, cv2.LINE_AA, 4)
    rough = cv2.GaussianBlur(image, (0, 0), 0.8) + np.random.default_rng(k).normal(0, 2, image.shape)
    return np.clip(np.rint(rough), 0, 255).astype(np.uint8)


def _stills(folder: Path) -> None:
    image = _image(0)
    colour = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    for name, pixels in (("still.png", image), ("still.jpg", colour), ("still.tif", colour), ("still.bmp", image)):
        cv2.imwrite(str(folder / name), pixels)
    cv2.imwrite(str(folder / "deep.png"), image.astype(np.uint16) << 4)
    cv2.imwrite(str(folder / "deep.tif"), image.astype(np.uint16) << 8)


def _frames(folder: Path) -> None:
    folder.mkdir()
    rows = ["file_name,time_s,knob_deg"]
    for k in range(6):
        cv2.imwrite(str(folder / f"{k}.png"), _image(k))
        rows.append(f"{k}.png,{k * 0.04:.3f},{10 + k}")
    (folder / "stamps.csv").write_text("\n".join(rows) + "\n")


def _recording(path: Path) -> None:
    unscaled = replace(INFO, views={"camera": ViewInfo(None, "left", None, (0, 0, 160, 120), "dark", "camera")})
    with RecordingWriter(path, unscaled, lossless=True) as writer:
        writer.state(INFO.sensor)
        for k in range(FRAMES):
            stamp = k * STEP_NS
            writer.write(Actuation(stamp, {"knob_deg": 10.0 + k}))
            for m in range(4):
                force = np.array([0.0, 0.2 * _bend(k), np.nan])
                writer.write(Wrench(stamp + m * STEP_NS // 4, force, np.full(3, np.nan), "sensor"))
            writer.write(Frame(stamp, _image(k)))


def _logs(folder: Path) -> None:
    times = np.arange(0, FRAMES * 40, 4)
    force = [f"{1e-3 * t:.3f},{0.01:.4f},{0.2 * _bend(int(t) // 40):.4f}" for t in times]
    (folder / "force.csv").write_text("time_s,fx_n,fy_n\n" + "\n".join(force) + "\n")
    stage = [f"{1e-3 * t:.3f},{0.1 * t:.3f}" for t in times]
    (folder / "stage.csv").write_text("time_s,stage_forward_mm\n" + "\n".join(stage) + "\n")
    knob = [f"{1e-3 * t:.3f},{10 + t // 100}" for t in times]
    (folder / "knob.csv").write_text("time_s,knob_deg\n" + "\n".join(knob) + "\n")


def _logs_of_other_programs(folder: Path) -> None:
    """The log of ATI's Net F/T demo, one of a German logger, a workbook, variables of MATLAB, and bags."""
    times = list(range(0, FRAMES * 40, 4))
    values = [[0.01, round(0.2 * _bend(t // 40), 4), 0.0] for t in times]
    head = "Start Time: 8/1/26 10:23 AM\nRDT Sample Rate: 250\nForce Units: lbf\nCounts per Unit Force: 1000000.0\n"
    head += "Status (hex), RDT Sequence, F/T Sequence, Fx, Fy, Fz, Tx, Ty, Tz, Time\n"
    rows: list[str] = []
    for k, (fx, fy, fz) in enumerate(values):
        cells = ["0x0", k + 1, k, *(round(1e6 * value) for value in (fx, fy, fz)), 0, 0, 0, "Aug 1, 2026 10:23:45 AM"]
        rows.append(",".join(f'"{cell}"' for cell in cells))
    (folder / "net_ft.csv").write_text(head + "\n".join(rows) + "\n")
    german = [
        f"01.08.2026;10:23:{45 + t // 1000}," + f"{t % 1000 // 10:02d};{fx};{fy}".replace(".", ",")
        for t, (fx, fy, _) in zip(times, values, strict=True)
    ]
    (folder / "german.csv").write_text("sep=;\nDatum;Uhrzeit;Fx;Fy\n;;[N];[N]\n" + "\n".join(german) + "\n")
    named = {"time_s": np.array(times) * 1e-3, "fx_n": np.array(values)[:, 0], "fy_n": np.array(values)[:, 1]}
    savemat(folder / "force.mat", named)
    if importlib.util.find_spec("openpyxl"):
        import openpyxl

        book = openpyxl.Workbook()
        book.active.append(list(named))
        for row in zip(*(column.tolist() for column in named.values()), strict=True):
            book.active.append(row)
        book.save(folder / "force.xlsx")
    if importlib.util.find_spec("rosbags"):
        from ..io.bag_files import run_messages, write_bag  # type: ignore[import-not-found]

        for kind in ("bag", "db3", "mcap"):
            shutil.copy(write_bag(folder / "bags", kind, run_messages(0.5)), folder / f"bag.{kind}")
            shutil.rmtree(folder / "bags")


def _dataset(folder: Path) -> None:
    (folder / "images").mkdir(parents=True)
    rows = ["file_name,session,stamp_ns,knob_deg,fx_n,fy_n"]
    for k in range(FRAMES):
        cv2.imwrite(str(folder / "images" / f"{k}.png"), _image(k))
        rows.append(f"images/{k}.png,s{k // 12},{k * STEP_NS},{10 + k % 3},0.01,{0.2 * _bend(k):.4f}")
    (folder / "metadata.csv").write_text("\n".join(rows) + "\n")
    write_dataset(open_dataset(folder), folder.with_name("written"))
    shutil.copy(folder.with_name("written") / "dataset.json", folder / "dataset.json")
    shutil.rmtree(folder.with_name("written"))


def _parquet(path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    cells = [{"bytes": cv2.imencode(".png", _image(k))[1].tobytes(), "path": f"{k}.png"} for k in range(FRAMES)]
    columns = {
        "image": cells,
        "session": [f"s{k // 12}" for k in range(FRAMES)],
        "stamp_ns": [k * STEP_NS for k in range(FRAMES)],
        "knob_deg": [10.0 + k % 3 for k in range(FRAMES)],
        "fy_n": [0.2 * _bend(k) for k in range(FRAMES)],
    }
    pyarrow.parquet.write_table(pyarrow.table(columns), path, row_group_size=8)


def _dicom(path: Path) -> None:
    from tipforce.simulation.rendering.fluoroscope import FLUORO, sample_xray_scene, write_dicom

    scene = sample_xray_scene(FLUORO, np.random.default_rng(1))
    write_dicom(path, [_image(k) for k in range(4)], [k * STEP_NS for k in range(4)], scene)


def make_corpus(folder: Path) -> None:
    """Fills ``folder``; what needs a package that is not installed is left out."""
    folder.mkdir(parents=True, exist_ok=True)
    _stills(folder)
    _frames(folder / "frames")
    _recording(folder / "run.mcap")
    _logs(folder)
    _logs_of_other_programs(folder)
    write_video(folder / "video.mp4", (Frame(k * STEP_NS, _image(k)) for k in range(12)), 25.0)
    _dataset(folder / "dataset")
    (folder / "bench.toml").write_text(bench_text(INFO))
    (folder / "bench.json").write_text(json.dumps(INFO.values()))
    settings = {
        "vision": {"polarity": "dark", "base_side": "left"}, "force": "components", "c": [10.0], "epsilon": [0.01],
        "sigma": [1.0], "folds": 2,
    }  # fmt: skip
    data = open_dataset(folder / "dataset")
    save_model(create("svr", settings).fit(data), folder / "svr", data)
    shutil.copytree(pretrained_folder("compact"), folder / "compact")
    if importlib.util.find_spec("pyarrow"):
        _parquet(folder / "shards.parquet")
    if importlib.util.find_spec("pydicom"):
        _dicom(folder / "run.dcm")
    with open_source(folder / "run.mcap") as source:  # good input is good
        assert sum(isinstance(event, Frame) for event in source) == FRAMES
