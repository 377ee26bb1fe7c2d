"""What is attacked: for each kind of input, the commands that read it, on files that were spoiled by chance."""

import importlib.util
import io
import json
import shutil
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from .spoil import NUMBERS, VALUES, Spoiler  # type: ignore[import-not-found]

__all__ = ["TARGETS", "Case", "Make"]


@dataclass(frozen=True)
class Case:
    """``words``: of the command line. ``names``: a refusal must hold one of them. ``refused``: always."""

    words: tuple[str, ...]
    names: tuple[str, ...]
    refused: bool = False


Make = Callable[[Spoiler, Path, Path], Case]
"""The spoiler, the folder of good files, an empty folder to work in -> what to run there."""


def _whole(path: Path) -> str:
    """The name of what is recovered from a ``.part``, else of the file."""
    return path.name.removesuffix(".part")


def _looked_at(path: Path, *more: str) -> Case:
    return Case(("inspect", str(path), "-o", "drawn.png", "--json", "figures.json", *more), (_whole(path),))


def _estimated(corpus: Path, path: Path, *names: str, model: Path | None = None) -> Case:
    chosen = model or corpus / "svr"
    words = ("estimate", str(chosen), str(path), "-o", "forces.csv", "--json", "figures.json")
    return Case(words, (_whole(path), *names))


_FAST = ("--set", "c=[10]", "--set", "epsilon=[0.01]", "--set", "sigma=[1]", "--set", "folds=2",
         "--set", "vision.polarity=dark", "--set", "vision.base_side=left")  # fmt: skip


def _trained(path: Path) -> Case:
    return Case(("train", str(path), "-o", "model", *_FAST), (path.name.split(".")[0],))  # the name of its session


# recordings


def _records(data: bytes, start: int = 8) -> list[tuple[int, int, int]]:
    """(opcode, start of the content, its length) of the records of an MCAP file or of a chunk's content."""
    found, at = [], start
    while at + 9 <= len(data):
        opcode, length = struct.unpack_from("<BQ", data, at)
        if at + 9 + length > len(data):
            break
        found.append((opcode, at + 9, length))
        at += 9 + length
    return found


def _unstated(data: bytes) -> bytes:
    """The same file without the checksums of its data and of its index, which the format allows."""
    for opcode, start, length in _records(data):
        if opcode in (2, 15):  # footer, end of the data
            data = data[: start + length - 4] + bytes(4) + data[start + length :]
    return data


def _spoiled_mcap(spoiler: Spoiler, data: bytes) -> bytes:
    """Bytes anywhere; or a record's length or content; or a message in a chunk whose checksum is right again."""
    if spoiler.calm:
        return data
    dice, way = spoiler.dice, spoiler.dice.randrange(4)
    if way == 0:
        return spoiler.data(data)
    data = _unstated(data)
    _, start, length = dice.choice(_records(data))
    if way == 1:
        return spoiler.number_at(data, start - 8, 8, "little")
    chunks = [record for record in _records(data) if record[0] == 6]
    if way == 2 or not chunks:
        at = start + 4 * dice.randrange(max(1, length // 4))
        return spoiler.number_at(data, at, dice.choice((2, 4, 8)), "little")
    _, start, length = dice.choice(chunks)
    name = struct.unpack_from("<I", data, start + 28)[0]
    body = start + 32 + name + 8
    content = bytearray(data[body : start + length])
    for _ in range(dice.choice((1, 1, 3))):
        _, inner, size = dice.choice(_records(bytes(content), 0))
        here = bytes(content[inner : inner + size])
        changed = spoiler.data(here)[:size].ljust(size, b"\0")
        content[inner : inner + size] = changed
    checksum = struct.pack("<I", zlib.crc32(content))
    return data[: start + 24] + checksum + data[start + 28 : body] + bytes(content) + data[start + length :]


def _mcap(spoiler: Spoiler, corpus: Path, folder: Path) -> Path:
    path = folder / f"spoiled.mcap{spoiler.one_of('', '', '', '.part')}"
    path.write_bytes(_spoiled_mcap(spoiler, (corpus / "run.mcap").read_bytes()))
    return path


def inspect_recording(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    return _looked_at(_mcap(spoiler, corpus, folder))


def inspect_recorded_images(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    return _looked_at(_mcap(spoiler, corpus, folder), "--frames", "--every", "6")


def estimate_recording(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    return _estimated(corpus, _mcap(spoiler, corpus, folder))


def train_on_recording(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    return _trained(_mcap(spoiler, corpus, folder))


# models


def _sums(folder: Path, manifest: Any) -> Any:
    """The manifest with the right checksums, as whoever altered the files would write them."""
    if not isinstance(manifest, dict) or not isinstance(manifest.get("sha256"), dict):
        return manifest
    sums = manifest["sha256"]
    for name in list(sums):
        if name not in ("model.json", "README.md") and (folder / name).is_file():
            sums[name] = sha256((folder / name).read_bytes()).hexdigest()
    others = {name: value for name, value in sums.items() if name != "model.json"}
    text = json.dumps({**manifest, "sha256": others}, sort_keys=True, ensure_ascii=False)
    sums["model.json"] = sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
    return manifest


def _model(spoiler: Spoiler, corpus: Path, folder: Path, name: str, way: str) -> Path:
    model = folder / "spoiled_model"
    shutil.copytree(corpus / name, model)
    path = model / "model.json"
    manifest = json.loads(path.read_text())
    if way == "manifest":
        manifest = spoiler.value(manifest)
    elif way == "settings":
        manifest["settings"] = spoiler.value(manifest["settings"])
    elif way == "state":
        manifest["state"] = spoiler.value(manifest["state"])
    elif way == "arrays":
        with np.load(model / "arrays.npz") as arrays:
            content = {key: arrays[key] for key in arrays.files}
        (model / "arrays.npz").write_bytes(spoiler.arrays(content))
    elif way == "graph":
        (model / "model.onnx").write_bytes(spoiler.data((model / "model.onnx").read_bytes()))
    manifest = _sums(model, manifest)
    path.write_bytes(spoiler.as_json(manifest))
    if way == "bytes":
        chosen = spoiler.one_of(*sorted(item for item in model.iterdir() if item.name != "README.md"))
        chosen.write_bytes(spoiler.data(chosen.read_bytes()))
    return model


def _with_model(name: str, way: str) -> Make:
    def make(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
        model = _model(spoiler, corpus, folder, name, way)
        if name == "compact":
            words = ("estimate", str(model), str(corpus / "still.png"), "-o", "forces.csv",
                     "--bench", str(corpus / "bench.toml"))  # fmt: skip
            return Case(words, (model.name, "still.png"))  # a model may ask for what the image does not have
        return Case(_estimated(corpus, corpus / "frames", model=model).words, (model.name, "frames"))

    return make


# images


def _image(spoiler: Spoiler, corpus: Path, folder: Path, names: tuple[str, ...]) -> Path:
    name = spoiler.one_of(*names)
    data = (corpus / name).read_bytes()
    if name.endswith(".png") and spoiler.chance(0.5):
        data = _spoiled_png(spoiler, data)
    elif name.endswith(".tif") and spoiler.chance(0.5):
        data = _spoiled_tiff(spoiler, data)
    elif name.endswith(".jpg") and spoiler.chance(0.5):
        at = data.find(b"\xff\xc0")
        data = spoiler.number_at(data, at + 4 + spoiler.dice.randrange(8), spoiler.one_of(1, 2), "big")
    else:
        data = spoiler.data(data)
    path = folder / f"spoiled{Path(name).suffix}"
    path.write_bytes(data)
    return path


def _spoiled_png(spoiler: Spoiler, data: bytes) -> bytes:
    """A chunk's content or length is another, its checksum is right again."""
    chunks, at = [], 8
    while at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        chunks.append((at, length))
        at += 12 + length
    at, length = spoiler.dice.choice((chunks[0], *chunks))
    if spoiler.chance(0.2):
        return spoiler.number_at(data, at, 4, "big")
    content = data[at + 8 : at + 8 + length]
    if at == 8 and spoiler.chance(0.7):
        content = spoiler.number_at(content, spoiler.one_of(0, 4, 8, 9, 12), spoiler.one_of(4, 1), "big")[:13]
    else:
        content = spoiler.data(content)
    chunk = data[at + 4 : at + 8] + content
    return (
        data[:at]
        + struct.pack(">I", len(content))
        + chunk
        + struct.pack(">I", zlib.crc32(chunk))
        + data[at + 12 + length :]
    )


def _spoiled_tiff(spoiler: Spoiler, data: bytes) -> bytes:
    """One entry of the first directory is another."""
    order = "little" if data[:2] == b"II" else "big"
    at = int.from_bytes(data[4:8], order)  # type: ignore[arg-type]
    count = int.from_bytes(data[at : at + 2], order)  # type: ignore[arg-type]
    entry = at + 2 + 12 * spoiler.dice.randrange(max(1, count))
    return spoiler.number_at(
        data, *spoiler.dice.choice(((entry + 8, 4), (entry + 4, 4), (entry + 2, 2), (entry, 2))), order
    )


def inspect_image(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    return _looked_at(
        _image(spoiler, corpus, folder, ("still.png", "still.tif", "still.jpg", "still.bmp", "deep.png", "deep.tif"))
    )


def estimate_image(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    path = _image(spoiler, corpus, folder, ("still.png", "still.tif", "still.jpg"))
    case = _estimated(corpus, path)
    return Case((*case.words, "--knob-deg", "10"), case.names)


def inspect_folder(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    """Images of other sizes and kinds among good ones, and their table."""
    frames = folder / "frames"
    shutil.copytree(corpus / "frames", frames)
    bad = frames / "2.png"
    if spoiler.chance(0.5):
        (frames / "stamps.csv").write_bytes(spoiler.encoded(spoiler.text((frames / "stamps.csv").read_text())))
    elif spoiler.chance(0.5):
        import cv2

        side = spoiler.dice.choice(((1, 1), (2, 2), (1, 300), (300, 1), (3, 5), (119, 161), (400, 500)))
        cv2.imwrite(str(bad), np.full(side, spoiler.dice.randrange(256), np.uint8))
    else:
        bad.write_bytes(_image(spoiler, corpus, folder, ("still.png", "deep.png", "still.jpg")).read_bytes())
    return Case(_looked_at(frames).words, ("frames", "2.png", "stamps.csv"))


# video


def _video(spoiler: Spoiler, corpus: Path, folder: Path) -> Path:
    data = (corpus / "video.mp4").read_bytes()
    if spoiler.chance(0.5):
        for kind in (
            spoiler.dice.choice(
                (b"stts", b"stsz", b"stco", b"stsc", b"tkhd", b"mdhd", b"avcC", b"stsd", b"mvhd", b"elst")
            ),
        ):
            at = data.find(kind)
            place = at - 4 + 4 * spoiler.dice.randrange(16) if at > 0 else 0
            data = spoiler.number_at(data, place, spoiler.dice.choice((2, 4)), "big")
    else:
        data = spoiler.data(data)
    path = folder / "spoiled.mp4"
    path.write_bytes(data)
    return path


def inspect_video(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    return _looked_at(_video(spoiler, corpus, folder), "--every", "4")


def import_video(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    path = _video(spoiler, corpus, folder)
    stated = ("--bench", str(corpus / "bench.toml"), "--offset-ms", "none")
    return Case(("import", str(path), str(corpus / "force.csv"), "-o", "run.mcap", *stated), (path.name, "run.mcap"))


# logs


_DATED = ("net_ft.csv", "german.csv")
"""Logs whose stamps are of another clock than those of the images."""


def _log(name: str) -> Make:
    def make(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
        path = folder / f"spoiled_{name}"
        if path.suffix == ".csv":
            path.write_bytes(spoiler.encoded(spoiler.text((corpus / name).read_text())))
        else:
            path.write_bytes(_spoiled_binary(spoiler, (corpus / name).read_bytes(), archive=path.suffix == ".xlsx"))
        logs = [str(path)] if name not in ("stage.csv", "knob.csv") else [str(corpus / "force.csv"), str(path)]
        options = (
            "--offset-ms",
            "start" if name in _DATED else spoiler.one_of("none", "auto", "start"),
            "--tare",
            spoiler.one_of("none", "auto", "0:0.2"),
        )
        knob = () if name == "knob.csv" else ("--knob-deg", "10")
        words = ("import", str(corpus / "frames"), *logs, *options, *knob, "--fact", "sensor.angle_deg=0",
                 "--fact", "sensor.reads=tip-on-tissue", "-o", "run.mcap")  # fmt: skip
        # the log of force also lies beside the others, and the recording is what they are to become
        return Case(words, (path.name, "force.csv", "run.mcap", "frames", "--"))

    return make


def _spoiled_binary(spoiler: Spoiler, data: bytes, *, archive: bool) -> bytes:
    """``data``, or one file in an archive."""
    if archive and spoiler.chance(0.7):
        return spoiler.archive(data, lambda _, content: spoiler.data(content) if spoiler.chance(0.3) else content)
    return spoiler.data(data)


# bags


def _bag(kind: str) -> Make:
    def make(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
        path = folder / f"spoiled.{kind}"
        path.write_bytes(spoiler.data((corpus / f"bag.{kind}").read_bytes()))
        stated = ("--fact", 'bag.names={knob_joint="knob_deg"}', "--offset-ms", "none")
        return Case(("import", str(path), "-o", "run.mcap", *stated), (path.name, "run.mcap"))

    return make


# datasets


def _dataset(spoiler: Spoiler, corpus: Path, folder: Path) -> Path:
    data = folder / "data"
    shutil.copytree(corpus / "dataset", data)
    way = spoiler.dice.random()
    table, facts = data / "metadata.csv", data / "dataset.json"
    if way < 0.6:
        table.write_bytes(spoiler.encoded(spoiler.text(table.read_text())))
    elif way < 0.85:
        facts.write_bytes(spoiler.as_json(spoiler.value(json.loads(facts.read_text()))))
    else:
        image = data / "images" / "3.png"
        image.write_bytes(_image(spoiler, corpus, folder, ("still.png", "deep.png")).read_bytes())
    return data


def inspect_dataset(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    return _looked_at(_dataset(spoiler, corpus, folder))


def train_on_dataset(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    return _trained(_dataset(spoiler, corpus, folder))


def estimate_dataset(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    case = _estimated(corpus, _dataset(spoiler, corpus, folder))
    return Case((*case.words, "--session", "s1"), case.names)


def _parquet(spoiler: Spoiler, corpus: Path, folder: Path) -> Path:
    path = folder / "spoiled.parquet"
    if spoiler.calm or spoiler.chance(0.5):
        path.write_bytes(spoiler.data((corpus / "shards.parquet").read_bytes()))
        return path
    import pyarrow
    import pyarrow.parquet

    columns = pyarrow.parquet.read_table(corpus / "shards.parquet").to_pydict()
    for _ in range(spoiler.dice.choice((1, 2))):
        name = spoiler.dice.choice(sorted(columns))
        way = spoiler.dice.randrange(4)
        if way == 0:
            del columns[name]
        elif way == 1:
            columns[name] = [spoiler.dice.choice(VALUES)] * len(columns[name])
        elif way == 2:
            columns[name][3] = None
        else:
            columns[name] = [spoiler.dice.choice((-(2**62), 2**62, 0, 10**15))] * len(columns[name])
        if not columns:
            break
    try:
        pyarrow.parquet.write_table(pyarrow.table(columns), path, row_group_size=spoiler.dice.choice((1, 8, 100)))
    except (pyarrow.ArrowException, OverflowError, UnicodeError, TypeError, ValueError):
        path.write_bytes(b"PAR1" + spoiler.dice.randbytes(40) + b"PAR1")  # no such table can be written
    return path


def inspect_parquet(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    return _looked_at(_parquet(spoiler, corpus, folder))


def train_on_parquet(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    return _trained(_parquet(spoiler, corpus, folder))


# bench.toml and options


def _bench(spoiler: Spoiler, corpus: Path, folder: Path) -> Path:
    path = folder / "spoiled.toml"
    if spoiler.chance(0.5):
        path.write_text(_toml(spoiler.value(json.loads((corpus / "bench.json").read_text()))), errors="surrogatepass")
    else:
        path.write_bytes(spoiler.encoded(spoiler.text((corpus / "bench.toml").read_text())))
    return path


def _toml(values: Any) -> str:
    """JSON values as TOML, also such as no person would write."""
    if not isinstance(values, dict):
        return f"a = {_inline(values)}\n"
    return "".join(f"{json.dumps(str(key))} = {_inline(value)}\n" for key, value in values.items())


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(str(key))} = {_inline(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(_inline(item) for item in value) + "]"
    return '""' if value is None else json.dumps(value).replace("NaN", "nan").replace("Infinity", "inf")


def bench_written_again(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    path = _bench(spoiler, corpus, folder)
    return Case(("init-bench", "--bench", str(path), "-o", "again.toml", "--no-ask"), (path.name,))


def inspect_with_bench(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    path = _bench(spoiler, corpus, folder)
    return Case(_looked_at(corpus / "still.png", "--bench", str(path)).words, (path.name, "still.png"))


def estimate_with_bench(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    path = _bench(spoiler, corpus, folder)
    return Case((*_estimated(corpus, corpus / "frames").words, "--bench", str(path)), (path.name, "frames"))


def network_with_bench(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    path = _bench(spoiler, corpus, folder)
    case = _estimated(corpus, corpus / "still.png", path.name, model=corpus / "compact")
    return Case((*case.words, "--bench", str(path)), case.names)


_DETECTION = {
    "method": "tracer", "polarity": "dark", "base_side": "left", "base_region": [0, 60, 20, 100],
    "roi": [0, 0, 160, 120], "threshold": 128, "base_columns": 20, "diameter_px": 7.0, "length_px": 110.0,
    "length_tolerance": 0.1, "max_gap_px": 12.0, "points": 64, "view": "camera",
}  # fmt: skip


def _set(spoiler: Spoiler, prefix: str, good: dict[str, Any]) -> list[str]:
    """One to four settings; values that are possible and such as are not."""
    words: list[str] = []
    for key in spoiler.dice.sample(sorted(good), 1 if len(good) == 1 else spoiler.dice.choice((1, 1, 2, 3))):
        value = good[key]
        if spoiler.chance(0.7):
            value = spoiler.strange_like(value) if spoiler.chance(0.8) else spoiler.value([value])
        text = value if isinstance(value, str) else json.dumps(value)
        if spoiler.chance(0.1):
            text = spoiler.dice.choice(NUMBERS)
        key = key if not spoiler.chance(0.03) else spoiler.dice.choice((key + ".x", "", ".", "__class__", key.upper()))
        words += ["--set", f"{prefix}{key}={text}".replace("\x00", "\ufffd")]  # no command line can hold a zero byte
    return words


def inspect_with_settings(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    words = _set(spoiler, "vision.", _DETECTION) + _set(
        spoiler, "features.", {"kind": "legendre", "degree": 4, "constant": True}
    )
    seen = spoiler.one_of("still.png", "frames")
    return Case(_looked_at(corpus / seen, *words).words, ("--set", seen))


def train_with_settings(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    settings = {
        "c": [10.0], "epsilon": [0.01], "sigma": [1.0], "folds": 2, "linear": 0.5, "label_average_ms": 40.0,
        "training_samples": 20, "tuning_samples": 20, "seed": 1, "force": "components", "scaling": "standard",
        "hold_out": "sample", "actuation": ["knob_deg"], "angles": {"degree": 3, "length": 1.0},
        "window": {"lags_ms": [0.0, 40.0], "average_ms": 80.0, "gap_ms": 500.0},
    }  # fmt: skip
    words = (*_FAST, *_set(spoiler, "", settings))
    return Case(("train", str(corpus / "dataset"), "-o", "model", *words), ("--set", "dataset"))


def simulate_with_settings(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    """Settings are judged all together and before anything is made: with a wrong one no case simulates for seconds."""
    settings = {"width": 64, "height": 48, "fps": 25.0, "world.seconds": 9.0, "world.tare_s": 2.0, "world.catheter": {}}
    words = ("--set", "nosuch=1", *_set(spoiler, "", settings))
    return Case(("simulate", "--sessions", "1", "-o", "runs", *words), ("--set",), refused=True)


def options(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    """Facts, tare, offset and knob as somebody types them."""
    dice = spoiler.dice

    def some(good: str) -> str:
        wrong = spoiler.text(good) if spoiler.chance(0.5) else dice.choice(NUMBERS)
        return (good if spoiler.calm else wrong).replace("\x00", "\ufffd")

    words = {
        "--fact": f"{some('views.camera.metres_per_px')}={some('2e-4')}", "--tare": some("0:0.2"),
        "--offset-ms": some("-12.5"), "--knob-deg": some("10"),
    }  # fmt: skip
    chosen = dice.sample(sorted(words), 2)
    given = [word for name in chosen for word in (name, words[name])]
    logged = ("import", str(corpus / "frames"), str(corpus / "force.csv"), "-o", "run.mcap")
    rest = [] if "--offset-ms" in chosen else ["--offset-ms", "none"]
    facts = ["--fact", "sensor.angle_deg=0", "--fact", "sensor.reads=tip-on-tissue"]
    return Case((*logged, *given, *rest, *facts), ("--", "fact ", "force.csv", "frames"))


# DICOM


def _dicom(spoiler: Spoiler, corpus: Path, folder: Path) -> Path:
    import pydicom

    path = folder / "spoiled.dcm"
    if spoiler.calm or spoiler.chance(0.5):
        path.write_bytes(spoiler.data((corpus / "run.dcm").read_bytes()))
        return path
    data = pydicom.dcmread(corpus / "run.dcm")
    tags = ("Rows", "Columns", "NumberOfFrames", "BitsAllocated", "BitsStored", "HighBit", "SamplesPerPixel",
            "PixelRepresentation", "PhotometricInterpretation", "FrameTimeVector", "FrameDelay", "FrameTime",
            "CineRate", "PixelData", "PlanarConfiguration")  # fmt: skip
    strange: tuple[Any, ...] = (0, 1, 3, 7, 12, 16, 255, 65535, -1, "", "nan", "1e400", "-5", "MONOCHROME1", "RGB", b"",
                                b"\0" * 7, [1, -1], None)  # fmt: skip
    for name in spoiler.dice.sample(tags, spoiler.dice.choice((1, 2))):
        try:
            if spoiler.chance(0.2):
                delattr(data, name)
            else:
                setattr(data, name, spoiler.dice.choice(strange))
        except (AttributeError, OverflowError, TypeError, ValueError):
            continue
    buffer = io.BytesIO()
    try:
        data.save_as(buffer)
    except Exception:  # what pydicom does not write, nobody can read
        return _dicom(spoiler, corpus, folder)
    path.write_bytes(buffer.getvalue())
    return path


def inspect_dicom(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
    return _looked_at(_dicom(spoiler, corpus, folder), "--every", "2")


# annotations


_POINTS = ((10, 70), (60, 66.5), (110, 50))


def _annotations() -> dict[str, str]:
    """Name -> content: the catheter's line in two of the frames, as our program and others write it."""
    ours = "".join(f"{k}.png,{u},{v + k}\n" for k in range(2) for u, v in _POINTS)
    numbers = [",".join(f"{u},{v + k},0.9" for u, v in _POINTS) for k in range(2)]
    parts = [part for part in ("base", "middle", "tip") for _ in "xyl"]
    coco = {
        "images": [{"id": k, "file_name": f"{k}.png", "width": 160, "height": 120} for k in range(2)],
        "annotations": [
            {"id": k, "image_id": k, "category_id": 1, "keypoints": [n for u, v in _POINTS for n in (u, v + k, 2)]}
            for k in range(2)
        ],
    }
    stored = [{"image": f"{k}.png", "points_px": _POINTS, "done": True} for k in range(2)]
    return {
        "ours.csv": f"image,u,v\n{ours}",
        "sleap.csv": "track,frame_idx,instance.score,"
        + ",".join(f"{part}.{axis}" for part in ("base", "middle", "tip") for axis in ("x", "y", "score"))
        + "".join(f"\nt,{k},0.9,{row}" for k, row in enumerate(numbers)),
        "deeplabcut.csv": "\n".join(
            [f"scorer{',A' * 9}", f"bodyparts,{','.join(parts)}", f"coords{',x,y,likelihood' * 3}"]
            + [f"labeled-data/m/{k}.png,{row}" for k, row in enumerate(numbers)]
        ),
        "coco.json": json.dumps(coco),
        "frames.annotations.json": json.dumps(
            {"format": "tipforce-annotations", "version": 1, "source": "frames", "frames": stored}
        ),
    }


def _annotated(name: str) -> Make:
    def make(spoiler: Spoiler, corpus: Path, folder: Path) -> Case:
        shutil.copytree(corpus / "frames", folder / "frames")
        text, path = _annotations()[name], folder / name
        if path.suffix == ".json" and spoiler.chance(0.8):
            path.write_bytes(spoiler.as_json(spoiler.value(json.loads(text))))
        else:
            path.write_bytes(spoiler.encoded(spoiler.text(text)))
        taken = () if name.startswith("frames") else ("--from", str(path))
        written = ("--export", spoiler.one_of("lines.csv", "lines.json"))
        return Case(("annotate", str(folder / "frames"), *taken, *written), (path.name, "frames"))

    return make


TARGETS: dict[str, tuple[Make, ...]] = {
    "recording": (
        inspect_recording,
        inspect_recorded_images,
        estimate_recording,
        inspect_recording,
        train_on_recording,
    ),
    "model": tuple(_with_model("svr", way) for way in ("manifest", "settings", "state", "arrays", "bytes")),
    "network": tuple(_with_model("compact", way) for way in ("settings", "state", "arrays", "graph")),
    "log": tuple(
        _log(name) for name in ("force.csv", "stage.csv", "knob.csv", "net_ft.csv", "german.csv", "force.mat")
    ),
    "image": (inspect_image, inspect_image, estimate_image, inspect_folder),
    "video": (inspect_video, inspect_video, inspect_video, import_video),
    "dataset": (inspect_dataset, estimate_dataset, inspect_dataset, train_on_dataset),
    "bench": (bench_written_again, bench_written_again, inspect_with_bench, estimate_with_bench, network_with_bench),
    "settings": (inspect_with_settings, inspect_with_settings, train_with_settings),
    "options": (options, simulate_with_settings),
    "annotations": tuple(map(_annotated, _annotations())),
}
"""Kind of input -> its commands, which take turns."""
if importlib.util.find_spec("pyarrow"):
    TARGETS["parquet"] = (inspect_parquet, inspect_parquet, train_on_parquet)
if importlib.util.find_spec("openpyxl"):
    TARGETS["log"] += (_log("force.xlsx"),)
if importlib.util.find_spec("rosbags"):
    TARGETS["bag"] = tuple(_bag(kind) for kind in ("bag", "db3", "mcap"))
if importlib.util.find_spec("pydicom"):
    TARGETS["dicom"] = (inspect_dicom,)
