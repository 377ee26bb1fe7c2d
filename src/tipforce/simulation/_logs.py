"""The logs of a session, in the form in which a laboratory has them beside the video: tables, and ``bench.toml``."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..types import FloatArray, IntArray, bench_text
from ._bench import SimulatedBench


def write_logs(bench: SimulatedBench, folder: Path) -> None:
    """Writes ``force.csv``, ``stage.csv`` and ``bench.toml`` of a session, and ``knob.csv`` if the knob moves.

    Force readings are tip-on-tissue in the sensor's frame, on the sensor's own clock; the stage's commands and the knob
    are on the camera's clock. ``bench.toml`` holds the facts that a person at the bench would write down, not the
    truth.

    Args:
        bench: the simulated session.
        folder: existing folder for the files.
    """
    log = bench.log
    wrench = {f"f{axis}_n": log.force_n[:, place] for place, axis in enumerate("xyz")}
    wrench |= {f"t{axis}_nm": log.torque_nm[:, place] for place, axis in enumerate("xyz")}
    _table(folder / "force.csv", log.stamp_ns, wrench)
    _table(folder / "stage.csv", *bench.stage_log())
    stamp_ns, knob_deg = bench.knob_log()
    info = bench.session_info
    if np.ptp(knob_deg) > 0.0:
        _table(folder / "knob.csv", stamp_ns, {"knob_deg": knob_deg})
    elif bench.has_knob:
        info = replace(info, actuation=replace(info.actuation, constant={"knob_deg": float(knob_deg[0])}))
    (folder / "bench.toml").write_text(bench_text(replace(info, name=""), guide=False), encoding="utf-8")


def _table(path: Path, stamp_ns: IntArray, columns: Mapping[str, FloatArray]) -> None:
    """Writes seconds to the microsecond, values to the resolution of their sensor."""
    rows = np.column_stack([stamp_ns * 1e-9, *columns.values()]) + 0.0  # no minus before a zero
    line = "%.6f" + ",%.6g" * len(columns)
    np.savetxt(path, rows, fmt=line, header=",".join(["time_s", *columns]), comments="", encoding="utf-8")
