"""The slow proof of the rod in space, run by `make prove`."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
def test_twenty_thousand_spatial_loads_converge_from_a_cold_start(tmp_path: Path) -> None:
    target = tmp_path / "loads.json"
    command = [sys.executable, "-m", "bench.spatial_loads", "--seed", "1", "--json", str(target)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    figures = json.loads(target.read_text())
    assert figures["count"] == 20_000
    assert figures["unconverged"] == 0
    assert figures["worst_residual"] < 1e-9
    assert figures["stable"] >= 19_990
    assert figures["unloaded_branch"] + figures["fallen"] == 20_000
    assert figures["unloaded_branch"] >= 19_900
    assert figures["crawled_and_agreed"] >= 290
    assert figures["crawled_and_differed"] == 0
