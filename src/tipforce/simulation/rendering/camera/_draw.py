"""Drawing a session's scene from ranges."""

import math

import numpy as np

from ._noise import SensorNoise
from ._profile import Lamp, TubeFinish
from ._ranges import SceneRanges
from ._scene import (
    CameraScene,
    CatheterLook,
    Colour,
    Cover,
    GroundLook,
    Instrument,
    Lens,
    Lighting,
    TissueLook,
)

__all__ = ["draw_scene"]

_TURNS = {"left": 0.0, "right": math.pi, "bottom": math.pi / 2, "top": -math.pi / 2}


def draw_scene(ranges: SceneRanges, rng: np.random.Generator, *, length_m: float = 0.048) -> CameraScene:
    """One session's scene. ``length_m``: of the catheter, base to apex, which covers and instruments are laid along.

    >>> one, two = (draw_scene(SceneRanges(), np.random.default_rng(3)) for _ in range(2))
    >>> one == two
    True
    """
    light = _lighting(ranges, rng)
    noise = SensorNoise.at_mid_grey(_of(rng, ranges.noise_grey), read_share=_of(rng, ranges.read_noise_share))
    lens = _lens(ranges, rng)
    ground = _ground(ranges, rng)
    catheter = _catheter(ranges, rng, 0.5 * ranges.diameter_m)
    tissue = _tissue(ranges, rng)
    instrument = _instrument(ranges, rng, length_m) if rng.random() < ranges.second_instrument else None
    return CameraScene(
        seed=int(rng.integers(2**31)),
        colour=ranges.colour,
        exposure_s=ranges.exposure_s,
        jpeg_quality=int(rng.integers(ranges.jpeg_quality[0], ranges.jpeg_quality[1] + 1)),
        light=light,
        lens=lens,
        noise=noise,
        catheter=catheter,
        ground=ground,
        tissue=tissue,
        instrument=instrument,
        covers=_covers(ranges, rng, length_m),
    )


def _of(rng: np.random.Generator, bounds: tuple[float, float]) -> float:
    return float(rng.uniform(*bounds))


def _colour(rng: np.random.Generator, grey: float, tint: float) -> Colour:
    """A colour that is seen as ``grey`` by a grey camera."""
    rgb = 1.0 + tint * rng.uniform(-1.0, 1.0, 3)
    rgb *= grey / float(rgb @ (0.299, 0.587, 0.114))
    return float(rgb[0]), float(rgb[1]), float(rgb[2])


def _lighting(ranges: SceneRanges, rng: np.random.Generator) -> Lighting:
    ambient = _of(rng, ranges.ambient)
    count = int(rng.integers(ranges.lamps[0], ranges.lamps[1] + 1))
    shares = rng.uniform(0.3, 1.0, count)
    shares *= (1.0 - ambient) / shares.sum()
    lamps: list[Lamp] = []
    for share in shares:
        up, turn = math.radians(_of(rng, ranges.lamp_elevation_deg)), rng.uniform(0.0, 2 * math.pi)
        direction = (math.cos(up) * math.cos(turn), math.cos(up) * math.sin(turn), math.sin(up))
        lamps.append(Lamp(direction, float(share)))
    return Lighting(
        level=_of(rng, ranges.light),
        gradient=_of(rng, ranges.light_gradient),
        gradient_rad=rng.uniform(0.0, 2 * math.pi),
        vignetting=_of(rng, ranges.vignetting),
        spot=_of(rng, ranges.light_spot),
        spot_at=(rng.uniform(-0.1, 1.1), rng.uniform(-0.1, 1.1)),
        ambient=ambient,
        lamps=tuple(lamps),
        lamp_size_rad=math.radians(_of(rng, ranges.lamp_size_deg)),
    )


def _lens(ranges: SceneRanges, rng: np.random.Generator) -> Lens:
    scale = _of(rng, ranges.scale_m_per_px)
    half = {"left": 0.0, "right": 640.0, "top": 320.0, "bottom": 320.0}[ranges.base_side] * scale
    down = {"left": 0.0, "right": 0.0, "top": -240.0, "bottom": 240.0}[ranges.base_side] * scale
    turn = _TURNS[ranges.base_side]
    shift = rng.uniform(*ranges.base_shift_m, 2)
    k1 = _of(rng, ranges.distortion_k1)
    p1, p2 = rng.uniform(*ranges.distortion_tangential, 2)
    # A defocus that is large in the catheter's own plane must leave a lens that is sharp somewhere.
    blur, defocus = _of(rng, ranges.blur_px), _of(rng, ranges.defocus_px_per_m)
    sharpest = float(np.clip(_of(rng, ranges.sharpest_m), -0.7 * blur / defocus, 0.7 * blur / defocus))
    return Lens(
        scale_m_per_px=scale,
        distance_m=_of(rng, ranges.camera_distance_m),
        base_at_m=(
            half + ranges.base_inset_m * math.cos(turn) + shift[0],
            down - ranges.base_inset_m * math.sin(turn) + shift[1],
        ),
        base_turn_rad=turn + math.radians(_of(rng, ranges.base_turn_deg)),
        yaw_rad=math.radians(_of(rng, ranges.yaw_deg)),
        pitch_rad=math.radians(_of(rng, ranges.pitch_deg)),
        distortion=(k1, 0.0, float(p1), float(p2), 0.0),
        blur_px=blur,
        sharpest_m=sharpest,
        defocus_px_per_m=defocus,
    )


def _ground(ranges: SceneRanges, rng: np.random.Generator) -> GroundLook:
    return GroundLook(
        kind=ranges.grounds[int(rng.integers(len(ranges.grounds)))],
        colour=_colour(rng, _of(rng, ranges.ground_grey), ranges.ground_tint),
        texture_grey=_of(rng, ranges.ground_texture_grey),
        lines_grey=_of(rng, ranges.ground_lines_grey),
        depth_m=_of(rng, ranges.ground_depth_m),
        objects=int(rng.integers(ranges.objects[0], ranges.objects[1] + 1)),
        clear_m=_of(rng, ranges.objects_clear_m),
    )


def _catheter(ranges: SceneRanges, rng: np.random.Generator, radius_m: float) -> CatheterLook:
    step = ranges.ring_m + ranges.ring_gap_m
    first = ranges.electrode_m + ranges.ring_gap_m
    finish = TubeFinish(
        shaft=_colour(rng, _of(rng, ranges.shaft_grey), ranges.shaft_tint),
        metal=_colour(rng, _of(rng, ranges.metal_grey), 0.04),
        gloss_grey=_of(rng, ranges.gloss_grey),
        sharpness=_of(rng, ranges.gloss_sharpness),
        rim_grey=_of(rng, ranges.rim_grey),
        metal_sharpness=rng.uniform(6.0, 30.0),
    )
    return CatheterLook(
        radius_m=radius_m,
        electrode_m=ranges.electrode_m,
        rings_m=tuple((first + k * step, first + k * step + ranges.ring_m) for k in range(ranges.rings)),
        finish=finish,
        seam=rng.uniform(0.2, 0.9),
        wear=_of(rng, ranges.wear),
    )


def _tissue(ranges: SceneRanges, rng: np.random.Generator) -> TissueLook:
    colour = np.array(ranges.tissue_colours[int(rng.integers(len(ranges.tissue_colours)))])
    colour = colour * rng.uniform(0.85, 1.1) * rng.uniform(0.95, 1.05, 3)
    return TissueLook(
        colour=(float(colour[0]), float(colour[1]), float(colour[2])),
        mottle=rng.uniform(0.01, 0.05),
        pad_m=(rng.uniform(6e-3, 12e-3), rng.uniform(10e-3, 16e-3)),
        plate_m=(rng.uniform(2.5e-3, 5e-3), rng.uniform(14e-3, 20e-3)),
        plate_grey=rng.uniform(60, 170),
        body_m=(rng.uniform(9e-3, 16e-3), rng.uniform(10e-3, 20e-3)),
        body_grey=rng.uniform(110, 185),
        arm_half_m=rng.uniform(4e-3, 10e-3),
        arm_grey=rng.uniform(45, 180),
        corner_m=rng.uniform(0.5e-3, 2.5e-3),
        over_tip=bool(rng.random() < ranges.tissue_over_tip),
    )


def _instrument(ranges: SceneRanges, rng: np.random.Generator, length_m: float) -> Instrument:
    """From beyond the picture's border to somewhere near the catheter, or across it."""
    turn = rng.uniform(0.25 * math.pi, 0.75 * math.pi) * rng.choice([-1.0, 1.0])
    way = np.array([math.cos(turn), math.sin(turn)])
    near = np.array([rng.uniform(0.2, 1.6) * length_m, 0.0]) + way * rng.uniform(-12e-3, 25e-3)
    start = near + way * 110e-3
    return Instrument(
        start_m=(float(start[0]), float(start[1])),
        end_m=(float(near[0]), float(near[1])),
        bow_m=rng.uniform(-12e-3, 12e-3),
        sway_m=rng.uniform(0.0, 4e-3),
        sway_hz=rng.uniform(0.2, 1.5),
        phase_rad=rng.uniform(0.0, 2 * math.pi),
        in_front=bool(rng.random() < 0.4),
        look=_catheter(ranges, rng, rng.uniform(0.5e-3, 1.6e-3)),
    )


def _covers(ranges: SceneRanges, rng: np.random.Generator, length_m: float) -> tuple[Cover, ...]:
    """One to three bands that hide, together, about the drawn share of the shaft."""
    share = _of(rng, ranges.hidden_share)
    if share <= 0.0:
        return ()
    count = int(rng.integers(1, 4))
    wide = rng.dirichlet(np.full(count, 4.0)) * share * length_m
    covers: list[Cover] = []
    for width in wide:
        kind = "cable" if width < 3e-3 else str(rng.choice(["tape", "bracket"]))
        colour = _colour(rng, rng.uniform(30, 215), 0.25)
        at = rng.uniform(0.08, 0.80) * length_m
        covers.append(Cover(kind, at - 0.5 * width, at + 0.5 * width, rng.uniform(-0.35, 0.35), colour))
    return tuple(covers)
