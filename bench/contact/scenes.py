"""Draws the training images: the surroundings of the tip in sessions of the presets, with the true geometry.

    python -m bench.contact.scenes --preset varied --seed 92000 --sessions 300 --out SCENES

One file a session, each with the frames at random instants; a run that was stopped goes on with the same command. Every
fifth number of a session is drawn: each has its own catheter and bench. Test sessions have other seeds (0 of the
protocol, 31337 to 89999 of docs/results).
"""

import argparse
import math
from pathlib import Path

import numpy as np

from tipforce._system.atomic import atomic_path
from tipforce.simulation import PRESETS, CameraImaging, SimulatedBench
from tipforce.simulation.world import FAST
from tipforce.vision.contact import crop_tip

SIDE_PX, PIXEL_M = 168, 0.22e-3
"""Larger and finer than the network's image: training moves, turns and scales it."""
SECONDS = 14.0


def draw(preset: str, seed: int, number: int, frames: int) -> dict[str, np.ndarray]:
    """Draws one session.

    Args:
        preset: name of the preset.
        seed: seed.
        number: number of the session.
        frames: number of frames.

    Returns:
        ``images`` (n, 168, 168); ``contact`` (n,); ``depth_m`` (n,) indentation; ``angle_rad`` (n,) direction of the
        force of the tissue from the tip's axis, in the image from u towards v; ``force_n`` (n,) its size in the plane;
        ``visible`` whether the tissue is visible in this session.
    """
    settings = PRESETS[preset]
    world = settings.world.model_copy(update={"seconds": SECONDS})
    bench = SimulatedBench(settings.model_copy(update={"world": world}), seed, number, resolution=FAST)
    rng = np.random.default_rng([seed, number, 4711])
    times, contact, when = bench.frame_s, bench.trajectory.contact, bench.interpolator
    after = np.flatnonzero(times > 0.25 * world.tare_s)
    chosen = np.sort(rng.choice(after, min(frames, len(after)), replace=False))
    camera = bench.imaging.camera(bench.views[0])
    scale = bench.session_info.view(bench.views[0]).metres_per_px
    assert scale is not None
    force = when.at(contact.force_n, times[chosen])
    lines = when.lines_m(times[chosen])
    depth = when.at(contact.indentation_m, times[chosen])
    touching = contact.touching[when.nearest(times[chosen])]
    visible = isinstance(bench.imaging, CameraImaging) and bench.imaging.scene.tissue.visibility == "in view"
    found: dict[str, list[object]] = {name: [] for name in ("images", "contact", "depth_m", "angle_rad", "force_n")}
    for k, index in enumerate(chosen.tolist()):
        ends = camera.project(lines[k][[-4, -1]])
        axis = ends[1] - ends[0]
        angle = math.atan2(axis[1], axis[0])
        size = float(np.linalg.norm(force[k, :2]))
        there = bool(touching[k]) and size > 1e-4
        # the force in the image: a short step along it at the tip
        step = camera.project(np.stack([lines[k][-1], lines[k][-1] + 1e-4 * force[k] / max(size, 1e-9)]))
        push = step[1] - step[0]
        found["images"].append(crop_tip(bench.frame(index).image, ends[1], angle, scale, SIDE_PX, PIXEL_M))
        found["contact"].append(there)
        found["depth_m"].append(float(depth[k]) if there else 0.0)
        found["angle_rad"].append(math.atan2(push[1], push[0]) - angle if there else 0.0)
        found["force_n"].append(size if there else 0.0)
    return {name: np.array(values) for name, values in found.items()} | {"visible": np.array(visible)}


def main() -> None:
    """Draws the sessions of one preset."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--preset", default="varied", choices=list(PRESETS))
    parser.add_argument("--seed", type=int, default=92000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--sessions", type=int, default=300)
    parser.add_argument("--frames", type=int, default=48)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for k in range(options.first, options.first + options.sessions):
        place = options.out / f"{options.preset}-{options.seed}-{k:04d}.npz"
        if not place.exists():
            drawn = draw(options.preset, options.seed, 5 * k, options.frames)
            with atomic_path(place) as part, part.open("wb") as file:
                np.savez(file, allow_pickle=False, **drawn)


if __name__ == "__main__":
    main()
