"""How well the offset between force log and camera is found on the small bench's sessions, over +-80 ms.

python bench/clock_offset.py [--sessions FOLDER] [--count 8] [--seconds 30] [--seed 0]

Each session's pictures are seen once; then its force log is shifted so that the true offset takes five values.
Without FOLDER the sessions are simulated first.
"""

import argparse
import json
import tempfile
from itertools import islice
from pathlib import Path

import numpy as np

from tipforce.recording import SensorPose, estimate_offset, find_tare, open_source, shape_coordinates, write_video
from tipforce.recording._forcelog import read_force_log
from tipforce.twin.small import SmallBenchSettings, read_truth, simulate
from tipforce.types import Frame
from tipforce.vision import Vision, VisionSettings, settle

OFFSETS_MS = (-80, -40, 0, 40, 80)


def errors_of(folder: Path) -> tuple[list[float], list[float]]:
    """Error and stated standard error in ms, for each of `OFFSETS_MS`; NaN where the estimate was refused."""
    facts, truth = json.loads((folder / "bench.json").read_text()), read_truth(folder)
    source = open_source(folder / "video.mp4")
    first = [event.image for event in islice(source, 50) if isinstance(event, Frame)]
    vision = Vision(settle(VisionSettings(), first[::5]))
    frames = [(event.stamp_ns, vision.see(event.image)) for event in source if isinstance(event, Frame)]
    flexible, rigid = facts["catheter"]["flexible_length_m"], facts["catheter"]["rigid_length_m"]
    shape = shape_coordinates([seen for _, seen in frames], flexible_share=flexible / (flexible + rigid))
    stamps = np.array([stamp for stamp, _ in frames])
    log = read_force_log(folder / "force.csv")
    pose = SensorPose(facts["sensor_angle_deg"], facts["reads"])
    force = (log.force_n - find_tare(log.stamp_ns, log.force_n).force_n) @ pose.matrix.T
    errors: list[float] = []
    doubts: list[float] = []
    for offset_ms in OFFSETS_MS:
        shift_ns = round(truth.clock_offset_s * 1e9) - offset_ms * 1_000_000
        found = estimate_offset(stamps, shape, log.stamp_ns + shift_ns, force)
        errors.append(found.offset_ms - offset_ms if found.how == "estimated" else float("nan"))
        doubts.append(found.stderr_ms)
    return errors, doubts


def main() -> None:
    """Read the command line, print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sessions", type=Path)
    parser.add_argument("--count", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        where = options.sessions
        if where is None:
            where = Path(name)
            settings = SmallBenchSettings(seconds=options.seconds)
            simulate(where, write_video, settings, sessions=options.count, seed=options.seed)
        print("error in ms of the offset found, by true offset (stated standard error)")
        print("session     " + "".join(f"{offset:>+8} ms    " for offset in OFFSETS_MS))
        every: list[float] = []
        for folder in sorted(path.parent for path in where.glob("*/video.mp4")):
            errors, doubts = errors_of(folder)
            every += errors
            cells = [f"{error:+7.2f} ({doubt:.1f})  " for error, doubt in zip(errors, doubts, strict=True)]
            print(f"{folder.name:<12}" + "".join(cells))
    found = np.array(every)
    share = np.mean(np.abs(found[~np.isnan(found)]) <= 3.0)
    print(
        f"{np.isnan(found).sum()} of {len(found)} refused; of the rest: mean {np.nanmean(found):+.2f}, "
        f"rms {np.sqrt(np.nanmean(found**2)):.2f}, worst {np.nanmax(np.abs(found)):.2f} ms, "
        f"{100 * share:.0f} % within 3 ms"
    )


if __name__ == "__main__":
    main()
