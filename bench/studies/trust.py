"""The trust table: errors of each estimator on benches that differ from its training bench.

    python -m bench.studies.trust pretrained/compact rod --runs build/trust --json build/trust.json --into PAGE.md

Each row changes one thing about the bench; its sessions are simulated once into ``--runs`` and kept between runs. The
rows of `bench-2021` share one seed: they are the same sessions except for the change. ``--other-engines FOLDER``
adds recordings of `benchmarks.foreign`. Models are folders, `pretrained/NAME`, or methods that need no training, with
settings, if wanted: ``fusion:vision.method=tracer``.
Magnitudes against the truth. Prints the table; ``--into FILE`` puts it between two marks in a page.
"""

import argparse
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tipforce.cli._settings import settings_from
from tipforce.datasets import Dataset, every_nth, open_recordings
from tipforce.estimators import ESTIMATORS, Estimator, load_model
from tipforce.evaluation import AS_SAVED, FEW_SAMPLES, axis_angle_deg, score, session_groups, stratum_metrics, truth_at
from tipforce.evaluation._metrics import json_ready
from tipforce.evaluation._predictions import collect, in_contact, with_reference
from tipforce.io import RecordingReader, atomic_text
from tipforce.pipelines import preset_settings, simulate
from tipforce.types import FloatArray, IntArray, SessionInfo
from tipforce.vision import INWARD

SEED = 7121
"""Seed of all rows but `varied`; nothing was trained or tuned on its sessions."""
VARIED_SEED = 0
"""The sessions with which every result of `varied` begins: for reporting, never for tuning."""
OTHER_ENGINES = "other engines"
NEAR_AXIS_DEG = 30.0
"""A force within this angle of the shaft's axis bends the shaft little."""
MARKS = "<!-- table of bench.studies.trust: begin -->", "<!-- table of bench.studies.trust: end -->"


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table: a preset, and the ``--set`` of `tipforce simulate` that change it."""

    preset: str = "bench-2021"
    changes: tuple[str, ...] = ()
    seed: int = SEED


def _scene(**changes: str) -> tuple[str, ...]:
    """`bench-2021` by the code that draws the scenes of `varied`, with ``changes`` of its `SceneVariety`."""
    plain = {
        "scale_m_per_px": "[1.9e-4,2.1e-4]",
        "margin_m": "0.033",  # leaves the camera next to no freedom to move away from the middle
        "sheath_m": "[0,0]",
        "fitting_share": "0",
        "shaft_grey": "[28,62]",
        "shaft_tint": "0.25",
        "rings": "[3,3]",
        "braid_share": "0",
        "dark_tip_share": "0",
        "blunt_share": "0",
        "ground_grey": "[165,210]",
        "rim_share": "0",
        "hidden_share": "0",
        "grey_share": "0",
        "mosaic_share": "0",
        "sharpen": "[0,0]",
        "front_objects": "[0,0]",
    }
    return ("scene.base_inset_m=0", *(f"scene.variety.{name}={value}" for name, value in (plain | changes).items()))


ROWS = {
    "nothing": Row(),
    "tissue 50 N/m": Row(changes=("world.wall.stiffness_n_per_m=[50,50]",)),
    "tissue 240 N/m": Row(changes=("world.wall.stiffness_n_per_m=[240,240]",)),
    "tissue law: Hertz": Row(changes=('world.wall.laws=["hertz"]',)),
    "tissue law: exponential": Row(changes=('world.wall.laws=["exponential"]',)),
    "curved face, 15 to 30 mm": Row(changes=('world.wall.faces=["convex"]', "world.wall.face_radius_m=[15e-3,30e-3]")),
    "tissue over the tip": Row(changes=("scene.tissue_over_tip=1",)),
    "tissue of the ground's grey": Row(
        changes=(
            "scene.carrier=false",
            "scene.ground_grey=[190,190]",
            "scene.ground_tint=0",
            "scene.tissue_colours=[[190,190,190]]",
        )
    ),
    "camera set up anew": Row(changes=_scene()),
    "the same, edge 0.5 to 3 mm nearer": Row(changes=_scene(rim_share="1", rim_m="[0.5e-3,3e-3]")),
    "preset generalise": Row("generalise"),
    "preset varied": Row("varied", seed=VARIED_SEED),
    "preset fluoro": Row("fluoro"),
}


def named(model: str) -> Estimator:
    """The ``model`` of the command line: a folder, or METHOD[:SETTING=VALUE,...]."""
    name, _, settings = model.partition(":")
    if not settings:
        return load_model(model)
    method = ESTIMATORS[name]
    return method(settings_from(method.settings_type, settings.split(",")))


def simulated(name: str, chosen: argparse.Namespace) -> Path:
    """The folder of a row's sessions, which are simulated where they are not there yet."""
    row = ROWS[name]
    base = preset_settings(row.preset, chosen.seconds)
    settings = settings_from(type(base), list(row.changes), base)
    folder: Path = chosen.runs / "".join(letter if letter.isalnum() else "-" for letter in name)
    simulate(folder, settings, sessions=chosen.sessions, seed=row.seed if chosen.seed is None else chosen.seed)
    return folder


def judged(model: Estimator, label: str, data: Dataset, truth_n: FloatArray) -> dict[str, Any]:
    """Figures of one cell of the table; magnitudes against the truth, in newtons and shares."""
    index = np.arange(len(data))
    found = collect(label, AS_SAVED, AS_SAVED, data, index, model.predict(data), in_contact(data, truth_n))
    base_frame = data.force_frames == {"base"}
    true = with_reference(found, truth_n)
    scored = score(true, groups=session_groups(data), base_frame=base_frame)
    magnitude, trust = scored["quantities"]["magnitude"], scored["trust"]
    near = true.where(true.contact & base_frame & (axis_angle_deg(true.reference_n) < NEAR_AXIS_DEG))
    return {
        "frames": scored["samples"],
        "sessions": len(data.sessions),
        "mae_n": magnitude["mae_n"],
        "bias_n": magnitude["bias_n"],
        "bias_near_axis_n": stratum_metrics(near)["bias_n"] if len(near) else np.nan,
        "frames_near_axis": len(near),
        "abstained": scored["abstained_share"],
        "abstained_because": scored["abstained"],
        "wrong": trust["wrong_share"],
        "coverage": magnitude["coverage"],
        "worst_coverage": trust["worst_coverage"],
        "worst_stratum": trust["worst_stratum"],
        "trust": trust,
    }


def marked(data: Dataset, folder: Path) -> Dataset:
    """The same, the base marked in each session's first image, as a person would: a box over its first three widths."""
    infos: dict[str, SessionInfo] = {}
    for path in sorted(folder.glob("*.truth.npz")):
        with RecordingReader(path.with_name(path.name.replace(".truth.npz", ".mcap"))) as file:
            info = file.session_info
        camera = info.view("camera")
        with np.load(path) as stored:
            curve, (width, height) = stored["centreline_px"][0], json.loads(str(stored["about"]))["image_size"]
        base = curve[int(((curve >= 0) & (curve < (width, height))).all(axis=1).argmax())]
        wide = (info.catheter.diameter_m or 0.0) / (camera.metres_per_px or 1.0)
        inward = np.array(INWARD[camera.base_side or "left"])
        near, far, aside = base - wide * inward, base + 3.0 * wide * inward, 2.5 * wide * np.abs(inward[::-1])
        corners = np.rint([np.minimum(near, far) - aside, np.maximum(near, far) + aside]).astype(int)
        left, top, right, bottom = corners.ravel().tolist()
        region = (max(left, 0), max(top, 0), min(right, width), min(bottom, height))
        infos[info.name] = replace(info, views={"camera": replace(camera, base_region=region)})
    return replace(data, session_info={name: infos[name] for name in data.session_info})


def truth_of(data: Dataset, folder: Path) -> FloatArray:
    """(n, 3) true forces of all samples, of our simulation or of another engine."""
    truths: dict[str, tuple[IntArray, FloatArray]] = {}
    for path in sorted(folder.glob("*.truth.npz")):
        with np.load(path) as stored, RecordingReader(path.with_name(path.name.replace(".truth.npz", ".mcap"))) as file:
            truths[file.session_info.name] = stored["stamp_ns"], stored["force_n"]
    return truth_at(data, truths)


_HEAD = (
    "change", "model", "MAE", "bias", "bias near the axis", "wrong", "coverage", "worst stratum", "abstained",
)  # fmt: skip


def table(figures: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> str:
    """The markdown table of row -> model -> `judged`; lengths in mN, shares in %."""
    lines = [f"| {' | '.join(_HEAD)} |", f"|{'---|' * len(_HEAD)}"]
    for row, models in figures.items():
        for place, (model, cell) in enumerate(models.items()):
            worst = f"{_share(cell['worst_coverage'])} ({cell['worst_stratum']})" if cell["worst_stratum"] else "-"
            near = _mn(cell["bias_near_axis_n"], "+")
            near += "*" if near != "-" and cell["frames_near_axis"] < FEW_SAMPLES else ""
            cells = (
                row if place == 0 else "", f"`{model}`", _mn(cell["mae_n"]), _mn(cell["bias_n"], "+"), near,
                _share(cell["wrong"]), _share(cell["coverage"]), worst, _share(cell["abstained"]),
            )  # fmt: skip
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _mn(newtons: float | None, sign: str = "") -> str:
    return "-" if newtons is None or np.isnan(newtons) else f"{1e3 * newtons:{sign}.0f}"


def _share(share: float | None) -> str:
    return "-" if share is None or np.isnan(share) else f"{100 * share:.0f}"


def into(page: Path, text: str) -> None:
    """Puts ``text`` between the two `MARKS` of ``page``."""
    whole = page.read_text(encoding="utf-8")
    if any(mark not in whole for mark in MARKS):
        raise SystemExit(f"{page}: has no place for the table; write the lines {MARKS[0]} and {MARKS[1]} into it")
    before, after = whole.split(MARKS[0])[0], whole.split(MARKS[1])[1]
    with atomic_text(page) as out:
        out.write(f"{before}{MARKS[0]}\n\n{text}\n\n{MARKS[1]}{after}")


def main() -> None:
    """Simulates missing sessions, evaluates the models, and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="+", metavar="MODEL")
    parser.add_argument("--runs", type=Path, default=Path("build/trust"), help="where the sessions are kept")
    parser.add_argument("--rows", nargs="+", choices=ROWS, metavar="ROW", default=list(ROWS), help="; ".join(ROWS))
    parser.add_argument("--other-engines", type=Path, metavar="FOLDER", help="sessions of benchmarks.foreign")
    parser.add_argument("--sessions", type=int, default=3, help="of each row")
    parser.add_argument("--seconds", type=float, default=15.0, help="of each session")
    parser.add_argument("--seed", type=int, help="of the sessions, in place of the rows' own")
    parser.add_argument("--marked", action="store_true", help="the base of each simulated session is marked")
    parser.add_argument("--every", type=int, default=2, help="every so many-th frame counts")
    parser.add_argument("--json", type=Path, default=Path("build/trust.json"), help="where the figures go")
    parser.add_argument("--into", type=Path, metavar="FILE", help="page whose table is replaced")
    chosen = parser.parse_args()
    models = {name: named(name) for name in chosen.models}
    figures: dict[str, dict[str, Any]] = {}
    for row in (*chosen.rows, *([OTHER_ENGINES] if chosen.other_engines else [])):
        other = row == OTHER_ENGINES
        folder = chosen.other_engines if other else simulated(row, chosen)
        recordings = sorted(folder.glob("session_*.mcap"))[: None if other else chosen.sessions]
        data = open_recordings(recordings, row)
        if not other:
            data = marked(data, folder) if chosen.marked else data
            data = every_nth(data, chosen.every)
        truth = truth_of(data, folder)
        figures[row] = {}
        for name, model in models.items():
            figures[row][name] = judged(model, name, data, truth)
            print(table({row: {name: figures[row][name]}}).splitlines()[-1], flush=True)
        chosen.json.parent.mkdir(parents=True, exist_ok=True)
        with atomic_text(chosen.json) as out:
            about = {
                "sessions": chosen.sessions,
                "seconds": chosen.seconds,
                "every": chosen.every,
                "seed": chosen.seed,
                "marked": chosen.marked,
            }
            rows = {name: asdict(each) for name, each in ROWS.items()}
            json.dump(json_ready({"about": about, "rows": rows, "figures": figures}), out, indent=1)
    text = table(figures)
    print(text)
    if chosen.into is not None:
        into(chosen.into, text)


if __name__ == "__main__":
    main()
