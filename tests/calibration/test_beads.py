"""The pose of a view from the marked beads of a phantom."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tipforce.calibration import calibrate_beads
from tipforce.cli import app
from tipforce.errors import InputError
from tipforce.geometry import CameraModel, CArm, Pose
from tipforce.types import read_bench

CAMERAS = {"a": CArm(-30.0, 10.0, 1.1, 0.75, 0.25e-3).camera(), "b": CArm(55.0, -5.0, 1.1, 0.76, 0.25e-3).camera()}
BEADS_M = 1e-3 * np.array([(x, y, z) for x in (-40, 40) for y in (-40, 5, 40) for z in (-40, 40)])


def error(found: CameraModel, true: CameraModel) -> np.ndarray:
    """(6,) turn in rad and shift in m; the distance for the true focal length."""
    own, other = found.camera_from_world, true.camera_from_world
    turn = Pose(found.camera_from_world.rotation @ other.rotation.T, np.zeros(3)).axis_angle_rad
    ratio = true.focal_px[1] / found.focal_px[1]
    shift = own.translation_m * (1.0, 1.0, ratio) - other.translation_m
    shift[:2] += (found.centre_px - true.centre_px) / found.focal_px * own.translation_m[2]
    return np.concatenate([turn, shift])


def test_standard_deviations_of_the_pose_hold() -> None:
    rng = np.random.default_rng(0)
    scores: list[np.ndarray] = []
    for _ in range(10):
        for camera in CAMERAS.values():
            pixels = camera.project(BEADS_M) + rng.normal(0.0, 0.5, (len(BEADS_M), 2))
            found = calibrate_beads(BEADS_M, pixels, "beads.csv")
            scores.append(error(found.camera, camera) / found.stds)
    share = np.mean(np.abs(scores) < 1.645, axis=0)
    assert (share > 0.65).all(), share


@pytest.mark.parametrize(
    ("points", "said"),
    [
        (BEADS_M[:6], "has 6 beads, and 8 are needed"),
        (BEADS_M * (1.0, 1.0, 0.0), "the beads are nearly in a plane"),
    ],
)
def test_beads_that_do_not_determine_the_pose_are_refused(points: np.ndarray, said: str) -> None:
    with pytest.raises(InputError, match=said):
        calibrate_beads(points, CAMERAS["a"].project(points), "beads.csv")


def test_a_bead_that_is_marked_wrongly_is_named() -> None:
    pixels = CAMERAS["a"].project(BEADS_M)
    pixels[4] += (30.0, 0.0)
    with pytest.raises(InputError, match=r"bead \d+ is .* px from the pixel that fits the other beads"):
        calibrate_beads(BEADS_M, pixels, "beads.csv")


def test_a_table_of_beads_writes_the_poses_of_both_views(tmp_path: Path) -> None:
    lines = ["view,u_px,v_px,x_mm,y_mm,z_mm"]
    for name, camera in CAMERAS.items():
        for point, pixel in zip(BEADS_M, camera.project(BEADS_M), strict=True):
            lines.append(",".join([name, *(f"{value:.2f}" for value in (*pixel, *1e3 * point))]))
    table = tmp_path / "beads.csv"
    table.write_text("\n".join(lines))
    target = tmp_path / "bench.toml"
    result = CliRunner().invoke(app, ["calibrate", "--beads", str(table), "-o", str(target)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert "view b: 12 beads fit to 0.0" in " ".join(result.output.split())
    info = read_bench(target)
    for name, camera in CAMERAS.items():
        view = info.view(name)
        assert view.projection is not None
        found = CameraModel.from_projection(view.projection)
        np.testing.assert_allclose(found.project(BEADS_M), camera.project(BEADS_M), atol=0.05)
        assert view.pose_uncertainty_deg is not None
        assert max(view.pose_uncertainty_deg) < 1.0
    table.write_text("view,u,v\na,1,2")
    result = CliRunner().invoke(app, ["calibrate", "--beads", str(table)])
    assert "line 2: expected the columns view,u_px,v_px,x_mm,y_mm,z_mm" in str(result.exception)
