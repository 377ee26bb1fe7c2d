import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tipforce.geometry import CameraModel, Pose, triangulate

LENS = np.array([-0.2, 0.05, 0.003, -0.002, 0.01])


def pair(degrees=90.0, lens=LENS):
    """Two cameras half a metre away from the origin, the second turned about the world's x by ``degrees``."""
    ahead = Pose.from_euler([0.0, 0.0, 0.0], [0.0, 0.0, 0.5])
    turned = ahead @ Pose.from_euler([np.radians(degrees), 0.0, 0.0], np.zeros(3))
    return [CameraModel([1200.0, 1210.0], [320.0, 240.0], lens, pose) for pose in (ahead, turned)]


def cloud(seed, n):
    return np.random.default_rng(seed).uniform(-0.05, 0.05, (n, 3))


def seen_by(cameras, points):
    return np.stack([camera.project(points) for camera in cameras], axis=1)


@settings(max_examples=30)
@given(st.integers(0, 1000), st.floats(5, 170))
def test_exact_pixels_give_the_points_back(seed, degrees):
    cameras, points = pair(degrees), cloud(seed, 10)
    found = triangulate(cameras, seen_by(cameras, points))
    np.testing.assert_allclose(found.points_m, points, atol=1e-9)
    np.testing.assert_allclose(found.residual_px, 0, atol=1e-6)


def test_the_covariance_is_that_of_the_errors():
    cameras = pair(60.0)
    points = np.tile(cloud(0, 1), (20_000, 1))
    noise = np.array([0.5, 1.5])
    rng = np.random.default_rng(1)
    seen = seen_by(cameras, points) + rng.normal(size=(len(points), 2, 2)) * noise[:, None]
    found = triangulate(cameras, seen, noise)
    error = found.points_m - points
    covariance = found.covariance_m2.mean(axis=0)
    np.testing.assert_allclose(np.cov(error.T), covariance, atol=0.03 * np.trace(covariance))
    # Three unknowns: the squared errors in units of the covariance average 3; the residuals hold the fourth number.
    assert np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance_m2), error).mean() == pytest.approx(3, 0.03)
    assert ((found.residual_px / noise[:, None]) ** 2).sum(axis=(1, 2)).mean() == pytest.approx(1, 0.05)


def test_refinement_is_never_worse_than_any_neighbour():
    cameras, points = pair(20.0), cloud(3, 50)
    seen = seen_by(cameras, points) + np.random.default_rng(4).normal(0, 2.0, (50, 2, 2))
    found = triangulate(cameras, seen)
    best = (found.residual_px**2).sum(axis=(1, 2))
    for way in np.vstack([np.eye(3), -np.eye(3)]) * 1e-4:
        other = ((seen - seen_by(cameras, found.points_m + way)) ** 2).sum(axis=(1, 2))
        assert (other > best).all()


def test_a_third_view_fills_in_for_one_that_sees_nothing():
    cameras = [*pair(90.0), pair(45.0)[1]]
    points = cloud(5, 6)
    seen = seen_by(cameras, points)
    seen[0, 0] = seen[1, 2] = np.nan
    seen[2, :2] = np.nan  # one view left: no point
    found = triangulate(cameras, seen)
    np.testing.assert_array_equal(np.isnan(found.points_m[:, 0]), [False, False, True, False, False, False])
    np.testing.assert_allclose(np.delete(found.points_m, 2, axis=0), np.delete(points, 2, axis=0), atol=1e-9)
    assert np.isnan(found.residual_px[0, 0]).all()
    assert np.isnan(found.covariance_m2[2]).all()
    assert np.trace(found.covariance_m2[3]) < np.trace(found.covariance_m2[0])


def test_parallel_rays_meet_nowhere():
    camera = pair()[0]
    found = triangulate([camera, camera], seen_by([camera, camera], cloud(6, 3)))
    assert np.isnan(found.points_m).all()


@pytest.mark.parametrize(
    ("count", "shape", "noise", "match"),
    [
        (1, (3, 1, 2), 1.0, "two cameras"),
        (2, (3, 3, 2), 1.0, r"expected shape \(n, 2, 2\)"),
        (2, (3, 2, 2), 0.0, "noise_px"),
    ],
)
def test_what_cannot_be_triangulated_is_refused(count, shape, noise, match):
    with pytest.raises(ValueError, match=match):
        triangulate(pair()[:count], np.zeros(shape), noise)
