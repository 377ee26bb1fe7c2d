"""How far each estimator can be trusted where the world is another than it was trained in: the trust table.

    python -m bench.trust pretrained/compact rod --runs build/trust --json build/trust.json --into docs/results/trust.md

Each row changes one thing about the bench; its sessions are simulated once into ``--runs`` and kept between runs. The
rows of `bench-2021` share one seed: they are the same sessions but for what is changed. ``--other-engines FOLDER``
adds recordings of `benchmarks.foreign`. Models are folders, `pretrained/NAME`, or methods that need no training.
Magnitudes against the truth. Prints the table; ``--into FILE`` puts it between two marks in a page.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tipforce.cli._settings import settings_from
from tipforce.datasets import Dataset, every_nth, open_dataset
from tipforce.estimators import Estimator, load_model
from tipforce.evaluation import json_ready, score
from tipforce.evaluation._predictions import collect, in_contact, with_reference
from tipforce.io import atomic_text
from tipforce.pipelines import preset_settings, simulate
from tipforce.types import FloatArray

SEED = 7121
"""Of all rows but `varied`; nothing was trained or tuned on its sessions."""
VARIED_SEED = 0
"""The sessions with which every result of `varied` begins: for reporting, never for tuning."""
OTHER_ENGINES = "other engines"
MARKS = "<!-- table of bench.trust: begin -->", "<!-- table of bench.trust: end -->"


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
    "camera set up anew": Row(changes=_scene()),
    "the same, tissue hidden": Row(changes=_scene(hidden_share="1")),
    "the same, edge 0.5 to 3 mm nearer": Row(changes=_scene(rim_share="1", rim_m="[0.5e-3,3e-3]")),
    "preset generalise": Row("generalise"),
    "preset varied": Row("varied", seed=VARIED_SEED),
    "preset fluoro": Row("fluoro"),
}


def simulated(name: str, runs: Path, sessions: int, seconds: float) -> Path:
    """The folder of a row's sessions, which are simulated where they are not there yet."""
    row = ROWS[name]
    base = preset_settings(row.preset, seconds)
    settings = settings_from(type(base), row.changes, base) if row.changes else base
    folder = runs / "".join(letter if letter.isalnum() else "-" for letter in name)
    simulate(folder, settings.model_copy(update={"preset": base.preset}), sessions=sessions, seed=row.seed)
    return folder
