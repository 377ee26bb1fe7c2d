"""The parts of ``python -m bench``: each measures something, shows it, and can be run alone."""

import argparse
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

__all__ = ["PARTS", "one_thread", "run_alone", "save"]

PARTS = {
    "spatial": "bench.spatial_rods",
    "camera": "bench.rendering",
    "fluoroscope": "bench.rendering_fluoroscope",
    "noise": "bench.noise",
    "force": "bench.speed",
    "networks": "bench.networks",
}
"""Module of each part; it has ``measure()`` -> figures and ``show(figures)``."""


def one_thread() -> None:
    """Keeps libraries from starting threads of their own; call it before they are imported."""
    for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    import cv2

    cv2.setNumThreads(1)


def save(target: Path, parts: dict[str, Any]) -> None:
    """Writes figures of some parts, and the machine on which they were measured."""
    from bench.machine import machine

    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(json.dumps({"machine": machine(), "parts": parts}, indent=2) + "\n", encoding="utf-8")


def run_alone(name: str, measure: Callable[[], Any], show: Callable[[Any], None], about: str | None) -> None:
    """Runs the command line of one part: ``python -m bench.MODULE [--json FILE]``."""
    parser = argparse.ArgumentParser(prog=f"python -m {PARTS[name]}", description=about)
    parser.add_argument("--json", type=Path, default=Path(f"build/bench_{name}.json"), help="where the figures go")
    chosen = parser.parse_args()
    one_thread()
    figures = measure()
    show(figures)
    save(chosen.json, {name: figures})
