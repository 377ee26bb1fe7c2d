"""The image of a tube lies where geometry says, to a hundredth of a pixel."""

import dataclasses
import math

import cv2
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.ndimage import map_coordinates, spline_filter
from skimage.draw import polygon

from tipforce.simulation.rendering.camera import CameraRenderer

LENGTH_M = 0.048
GROUND, SHAFT = 190.0, 40.0
SHAPES = [0.0, 0.5, -1.3]


def cover(renderer, shape):
    """Cover without shading: two images whose shafts differ, everything else alike."""
    bright = dataclasses.replace(renderer.scene.catheter.finish, shaft=(SHAFT * 2,) * 3, metal=(SHAFT * 2,) * 3)
    appearance = dataclasses.replace(renderer.scene.catheter, finish=bright)
    other = CameraRenderer(dataclasses.replace(renderer.scene, catheter=appearance), LENGTH_M)
    dark, light = renderer.clean(shape), other.clean(shape)
    shaft = light - dark  # shading times cover
    return 1.0 - (dark - shaft) / GROUND


def outlines(camera, shape, radius, count=4000):
    """The two outlines of the tube (count, 2) px and that of its dome, from the lines of sight that touch it.

    Found by search: of all points around a section, that whose normal is perpendicular to its line of sight.
    """
    s = np.linspace(0.0, LENGTH_M, shape.shape[1])
    axis = CubicSpline(s, shape[0])
    at = np.linspace(0.0, LENGTH_M - radius, count)
    middle, tangent = axis(at), axis(at, 1)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    up = np.cross(tangent, np.cross([0.0, 0.0, 1.0], tangent))
    up /= np.linalg.norm(up, axis=1)[:, None]
    side = np.cross(up, tangent)
    sides = []
    for low, high in ((-math.pi / 2, math.pi / 2), (math.pi / 2, 3 * math.pi / 2)):
        low, high = np.full(count, low), np.full(count, high)
        for _ in range(45):
            turn = 0.5 * (low + high)
            normal = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * up
            point = middle + radius * normal
            seen = ((point - camera.position_m) * normal).sum(axis=1) * np.sign(np.cos(turn[0]))
            # on the side of the camera the normal points towards it
            away = seen * np.sign(np.cos(turn[0])) > 0
            far_is_low = np.cos(turn[0]) > 0
            low = np.where(away == far_is_low, turn, low)
            high = np.where(away == far_is_low, high, turn)
        sides.append(camera.project(point))
    to_dome = middle[-1] - camera.position_m
    far = np.linalg.norm(to_dome)
    ahead = to_dome / far
    one = np.cross(ahead, [0.0, 1.0, 0.0])
    one /= np.linalg.norm(one)
    turn = np.linspace(0, 2 * math.pi, 240, endpoint=False)[:, None]
    ring = np.cos(turn) * one + np.sin(turn) * np.cross(ahead, one)
    touching = middle[-1] - ahead * radius**2 / far + radius * math.sqrt(1 - (radius / far) ** 2) * ring
    return sides[0], sides[1], camera.project(touching)


def brute_force(camera, shape, radius, sigma, box, finer=8):
    """The cover by supersampling the outlines and blurring the fine image, at the centres of pixels."""
    u0, v0, w, h = box
    left, right, dome = outlines(camera, shape, radius, 300)
    fine = np.zeros((h * finer, w * finer), np.float32)
    for path in (np.concatenate([left, right[::-1]]), dome):
        at = (path - (u0, v0) + 0.5) * finer - 0.5
        fine[polygon(at[:, 1], at[:, 0], fine.shape)] = 1.0
    fine = cv2.GaussianBlur(fine, (0, 0), sigma * finer, borderType=cv2.BORDER_REPLICATE)
    middle = slice(finer // 2 - 1, finer // 2 + 1)
    return fine.reshape(h, finer, w, finer)[:, middle, :, middle].mean(axis=(1, 3))


@pytest.mark.slow
def test_the_image_is_that_of_exact_outlines_finely_sampled_and_blurred(arc, plain):
    scene = plain(blur_px=1.2, defocus_px_per_m=0.0)
    renderer = CameraRenderer(scene, LENGTH_M)
    shape = arc(-1.3, out_of_plane=1.5)
    share = cover(renderer, shape)
    box = (70, 40, 240, 400)
    want = brute_force(renderer.camera, shape, scene.catheter.radius_m, 1.2, box)
    off = np.abs(share[40:440, 70:310] - want)
    off[:, :5] = 0.0  # the finely sampled image ends here
    edge = (want > 0.02) & (want < 0.98)
    assert edge.sum() > 1500
    assert off[edge].mean() < 0.001  # of the contrast: 0.003 px where the edge is steepest
    assert off.max() < 0.015


def crossings(share, centre, normal, reach=12.0):
    """Where the cover passes 1/2 along the normal at ``centre``, on either side, px."""
    at = np.arange(-reach, reach + 1e-9, 0.05)
    u, v = centre[:, None] + normal[:, None] * at
    line = map_coordinates(share, [v, u], order=5, prefilter=False)
    found = []
    for low, high in ((0, at.size // 2), (at.size // 2, at.size)):
        part = line[low:high] - 0.5
        k = int(np.flatnonzero(part[:-1] * part[1:] <= 0)[0])
        found.append(at[low + k] + 0.05 * part[k] / (part[k] - part[k + 1]))
    return np.array(found)


@pytest.mark.parametrize("turning", SHAPES)
def test_edges_and_centre_are_exact(turning, arc, plain):
    sigma = 1.1
    renderer = CameraRenderer(plain(blur_px=sigma, defocus_px_per_m=0.0), LENGTH_M)
    shape = arc(turning, out_of_plane=1.5)
    share = spline_filter(cover(renderer, shape), order=5)
    left, right, _ = outlines(renderer.camera, shape, renderer.scene.catheter.radius_m, 800)
    axis = CubicSpline(np.linspace(0, LENGTH_M, shape.shape[1]), shape[0])(
        np.linspace(0, LENGTH_M - renderer.scene.catheter.radius_m, 800)
    )
    axis = renderer.camera.project(axis)
    bend = turning / LENGTH_M * renderer.scene.lens.scale_m_per_px  # 1/px, to first order
    missed, centred = [], []
    for k in range(40, 720, 17):
        way = axis[k + 1] - axis[k - 1]
        normal = np.array([-way[1], way[0]]) / np.hypot(*way)
        got = crossings(share, axis[k], normal)
        want = np.sort([(side[k] - axis[k]) @ normal for side in (left, right)])
        # Blur draws a bent edge towards the centre of its bend by bend sigma^2 / 2 (v points down: y turns to -v).
        missed.append(got - want + 0.5 * bend * sigma**2)
        centred.append(got.mean() + 0.5 * bend * sigma**2)
    assert np.abs(missed).max() < 0.01
    assert np.abs(centred).max() < 0.01
    assert np.abs(np.mean(centred)) < 0.004


def test_truth_is_the_projected_axis_and_its_mask_is_as_large_as_the_tube(arc, plain):
    renderer = CameraRenderer(plain(), LENGTH_M)
    shape = arc(0.5)
    truth = renderer.truth(shape)
    np.testing.assert_allclose(truth.centreline_px, renderer.camera.project(shape[0]), atol=1e-9)
    radius, scale = renderer.scene.catheter.radius_m, renderer.scene.lens.scale_m_per_px
    u, _ = truth.centreline_px.T
    area = (2 * radius * (LENGTH_M - radius) + 0.5 * math.pi * radius**2) / scale**2
    behind = renderer.truth(shape - [LENGTH_M, 0.0, 0.0]).mask.sum()  # what goes on behind the base is seen too
    assert truth.mask[:, round(u[0]) :].sum() == pytest.approx(area, rel=0.02)
    assert truth.visible.all()
    assert truth.visible_share == pytest.approx(1.0)
    assert behind < truth.mask.sum()


def test_blur_and_motion_conserve_the_light(arc, plain):
    shape = arc(0.4)
    still = CameraRenderer(plain(blur_px=0.8, defocus_px_per_m=0.0), LENGTH_M)
    soft = CameraRenderer(plain(blur_px=1.5, defocus_px_per_m=0.0), LENGTH_M)
    way = np.linspace(-0.5, 0.5, 3)[:, None, None] * np.array([0.0, 0.8e-3, 0.0])
    lost = [GROUND * 480 * 640 - float(r.clean(s).sum(dtype=float)) for r, s in (
        (still, shape), (soft, shape), (still, shape + way))]  # fmt: skip
    assert lost[1] == pytest.approx(lost[0], rel=5e-4)
    assert lost[2] == pytest.approx(lost[0], rel=5e-4)


def test_motion_blur_is_the_mean_over_the_exposure(arc, plain):
    renderer = CameraRenderer(plain(blur_px=0.8, defocus_px_per_m=0.0), LENGTH_M)
    shape = arc(0.6)
    way = np.array([0.2e-3, 0.7e-3, 0.0])
    blurred = renderer.clean(shape + np.linspace(-0.5, 0.5, 5)[:, None, None] * way)
    many = (np.arange(60) + 0.5) / 60 - 0.5
    mean = np.mean([renderer.clean(shape + share * way) for share in many], axis=0)
    assert np.abs(mean - renderer.clean(shape)).max() > 20.0
    assert np.abs(blurred - mean).max() < 0.6


def test_the_blur_depends_on_the_depth(arc, plain):
    renderer = CameraRenderer(plain(blur_px=0.9, defocus_px_per_m=120.0), LENGTH_M)
    sharp, far = (
        np.abs(np.diff(renderer.clean(arc(0.0) + np.array([0.0, 0.0, z])), axis=0)).max() for z in (0.0, -8e-3)
    )
    assert far < 0.85 * sharp
