"""Differences between other people's benches: camera, framing, sheath, catheter, tissue. Numbers are usual ranges."""

import math
from dataclasses import dataclass, replace

import numpy as np

from ....mechanics import face_depths
from ....types import FloatArray
from ..._fields import NotNegative, Positive, Range, Settings, Share, Some
from ._scene import (
    Braid,
    CameraScene,
    CatheterAppearance,
    Colour,
    CoverPlate,
    Lens,
    Occluder,
    SensorPipeline,
    Sheath,
    TissueAppearance,
    TubeFinish,
)


class SceneVariety(Settings):
    """Ranges of a scene beyond `SceneRanges`. A range is (low, high): one uniform draw a session, or a catheter."""

    scale_m_per_px: Range = (0.10e-3, 0.30e-3)
    """Scale of the images; no smaller than lets the catheter be in view."""
    margin_m: Positive = 4e-3
    """Between the catheter, wherever it goes, and the image's borders, but for the one it comes from."""
    distance_over_field: Range = (1.2, 2.5)
    """Distance of the camera over the width of its field."""

    sheath_m: Range = (0.0, 40e-3)
    """In view before its mouth."""
    sheath_wider: Range = (1.2, 2.5)
    """Its diameter over the shaft's."""
    sheath_grey: Range = (20.0, 225.0)
    fitting_share: Share = 0.25
    """Sessions with a stopper or a clamp at the mouth."""

    shaft_grey: Range = (15.0, 230.0)
    shaft_tint: NotNegative = 0.6
    rings: Some = (0, 4)
    braid_share: Share = 0.5
    braid_contrast: Range = (0.05, 0.35)
    braid_pitch_m: Range = (0.6e-3, 2.2e-3)
    dark_tip_share: Share = 1 / 3
    blunt_share: Share = 1 / 3
    """Catheters whose tip is flat; the others have a dome."""

    ground_grey: Range = (18.0, 230.0)
    least_contrast_grey: NotNegative = 35.0
    """Between shaft and ground: who sets up a bench takes a ground on which the shaft is seen. Half of the sessions are
    dark on light, as far as the shaft allows."""

    bright_grey: NotNegative = 120.0
    """Exposure brings the brighter of shaft and ground to this at least."""
    white_grey: Positive = 240.0
    """Nor does it bring the ground's brightest colour beyond this, but for lamps and highlights."""

    rim_share: Share = 0.5
    rim_m: Range = (0.0, 3e-3)
    """Length of a rim that is before the tissue and hides the indentation."""
    hidden_share: Share = 1 / 3
    """Share of sessions in which tissue and carrier are hidden, or of the ground's grey."""
    most_behind_m: NotNegative = 15e-3
    """Where a plate or the border would hide more of the tip than this, the tissue is in fluid or of the ground's grey
    instead."""
    fluid_opacity: Range = (0.0, 0.08)

    grey_share: Share = 0.5
    mosaic_share: Share = 0.75
    """Sessions whose camera has one colour a photosite; the others' noise is not spread by interpolation."""
    sharpen: Range = (0.2, 1.2)
    sharpen_px: Range = (0.8, 1.6)
    front_objects: Some = (0, 3)
    front_blur_px: Range = (4.0, 14.0)


@dataclass(frozen=True, slots=True, eq=False)
class Framing:
    """Positions of catheter and tissue, as the person who sets up the camera knows them; base frame.

    Attributes:
        size: width and height of the images.
        base_side: side of the image at which the catheter enters.
        reach_m: (k, 3) positions of catheter and tip at times spread over the session.
        forward: (2,) direction into the tissue.
        face_m: position of the face along it when the stage has come farthest against the tip.
        behind_m: longest way of the tip beyond that.
        aside_m: position of the touched point across.
        face_radius_m: radius of the face, see `TissueAppearance`.
    """

    size: tuple[int, int]
    base_side: str
    reach_m: FloatArray
    forward: FloatArray
    face_m: float
    behind_m: float
    aside_m: float
    face_radius_m: float | None


def tinted(rng: np.random.Generator, grey: float, tint: float) -> Colour:
    """Draws a colour of a given grey level.

    Args:
        rng: random numbers.
        grey: level of the colour in a grey camera.
        tint: largest relative deviation of a channel before the colour is scaled to ``grey``.

    Returns:
        RGB grey levels.
    """
    rgb = 1.0 + tint * rng.uniform(-1.0, 1.0, 3)
    rgb *= grey / float(rgb @ (0.299, 0.587, 0.114))
    return float(rgb[0]), float(rgb[1]), float(rgb[2])


def vary_scene(
    scene: CameraScene,
    variety: SceneVariety,
    framing: Framing,
    rng: np.random.Generator,
    catheter_rng: np.random.Generator,
) -> CameraScene:
    """Draws the variation of another bench and applies it to a scene.

    Args:
        scene: the scene.
        variety: ranges of the variation.
        framing: positions of catheter and tissue.
        rng: random numbers of the bench.
        catheter_rng: random numbers that all sessions of a catheter share.

    Returns:
        The varied scene.
    """
    catheter, shaft_grey = _catheter(scene.catheter, variety, catheter_rng)
    ground = replace(scene.ground, colour=tinted(rng, _ground_grey(variety, shaft_grey, rng), 0.15))
    # Exposure: the brighter of shaft and ground is bright enough, and the ground is not overexposed.
    least_level = variety.bright_grey / max(shaft_grey, float(np.dot(ground.colour, (0.299, 0.587, 0.114))))
    level = min(max(scene.light.level, least_level), variety.white_grey / max(ground.colour))
    light = replace(scene.light, level=level)
    sheath = _sheath(catheter, variety, rng)
    framing = _before_corners(framing, scene.tissue.pad_m[1])
    tissue = _tissue(replace(scene, ground=ground), variety, framing, rng)
    lens, inset_m = _frame(scene.lens, variety, framing, tissue.visibility == "cropped", rng)
    occluders = scene.occluders
    if sheath.fitting == "clamp" and inset_m > sheath.fitting_m:
        occluders = (*occluders, Occluder("bracket", -sheath.fitting_m, -0.2e-3, float(rng.uniform(-0.1, 0.1)),
                                    sheath.fitting_colour))  # fmt: skip
    cover = _cover_plate(framing, rng) if tissue.visibility == "behind a plate" else None
    grey_camera = bool(rng.random() < variety.grey_share)
    mosaic = bool(rng.random() < variety.mosaic_share)
    return replace(
        scene,
        light=light,
        colour=mosaic or not grey_camera,
        lens=lens,
        catheter=catheter,
        ground=ground,
        tissue=tissue,
        occluders=occluders,
        sheath=sheath if inset_m > 0.0 else None,
        cover=cover,
        pipeline=SensorPipeline(
            mosaic, float(rng.uniform(*variety.sharpen)), float(rng.uniform(*variety.sharpen_px)), grey_camera
        ),
        front_objects=int(rng.integers(variety.front_objects[0], variety.front_objects[1] + 1)),
        front_blur_px=float(rng.uniform(*variety.front_blur_px)) * framing.size[0] / 640.0,  # stated for 640 columns
    )


def _before_corners(framing: Framing, half_m: float) -> Framing:
    """Returns the framing with ``face_m`` at the corners of a concave face, which are nearer to the catheter.

    ``half_m``: half the width of the tissue. Other faces keep their framing.
    """
    if framing.face_radius_m is None or framing.face_radius_m > 0.0:
        return framing
    sagitta_m = -float(face_depths(framing.face_radius_m, np.array([half_m]))[0])
    return replace(framing, face_m=framing.face_m - sagitta_m, behind_m=framing.behind_m + sagitta_m)


def _catheter(
    plain: CatheterAppearance, variety: SceneVariety, rng: np.random.Generator
) -> tuple[CatheterAppearance, float]:
    """Draws the appearance of one catheter, the same in all of its sessions; returns it and its shaft's grey level.

    Radius and electrode are those of ``plain``; finish, rings, braid and tip are new.
    """
    grey = float(rng.uniform(*variety.shaft_grey))
    dark_tip = rng.random() < variety.dark_tip_share
    metal = float(rng.uniform(20.0, 60.0) if dark_tip else rng.uniform(95.0, 195.0))
    finish = TubeFinish(
        shaft=tinted(rng, grey, variety.shaft_tint),
        metal=tinted(rng, metal, 0.04),
        gloss_grey=float(rng.uniform(0.0, 150.0)),
        sharpness=float(rng.uniform(8.0, 120.0)),
        rim_grey=float(rng.uniform(0.0, 60.0)),
        metal_sharpness=float(rng.uniform(6.0, 30.0)),
    )
    ring_m, gap_m = float(rng.uniform(0.8e-3, 2.5e-3)), float(rng.uniform(1.5e-3, 5e-3))
    count = int(rng.integers(variety.rings[0], variety.rings[1] + 1))
    first_m = plain.electrode_m + gap_m
    braid = None
    if rng.random() < variety.braid_share:
        braid = Braid(
            float(rng.uniform(*variety.braid_contrast)),
            float(rng.uniform(*variety.braid_pitch_m)),
            float(rng.uniform(2.0, 5.0)),
        )
    catheter = replace(
        plain,
        finish=finish,
        rings_m=tuple((first_m + k * (ring_m + gap_m), first_m + k * (ring_m + gap_m) + ring_m) for k in range(count)),
        braid=braid,
        blunt=6.0 if rng.random() < variety.blunt_share else 2.0,
    )
    return catheter, grey


def _ground_grey(variety: SceneVariety, shaft: float, rng: np.random.Generator) -> float:
    """Draws a grey level of the ground with enough contrast to the ``shaft``'s, darker or lighter if both exist."""
    low, high = variety.ground_grey
    darker, lighter = (low, shaft - variety.least_contrast_grey), (shaft + variety.least_contrast_grey, high)
    sides = [side for side in (darker, lighter) if side[1] > side[0]]
    return float(rng.uniform(*sides[int(rng.integers(len(sides)))]))


def _sheath(catheter: CatheterAppearance, variety: SceneVariety, rng: np.random.Generator) -> Sheath:
    """Draws the tube around the base: wider than the ``catheter``, with a flat end, sometimes with a fitting."""
    finish = replace(
        catheter.finish,
        shaft=tinted(rng, float(rng.uniform(*variety.sheath_grey)), variety.shaft_tint),
        gloss_grey=float(rng.uniform(0.0, 120.0)),
    )
    wider = float(rng.uniform(*variety.sheath_wider))
    fitting = ""
    if rng.random() < variety.fitting_share:
        fitting = "stopper" if rng.random() < 0.5 else "clamp"
    return Sheath(
        replace(
            catheter, radius_m=wider * catheter.radius_m, electrode_m=0.0, rings_m=(), finish=finish, braid=None,
            blunt=8.0,
        ),
        fitting,
        float(rng.uniform(4e-3, 12e-3)),
        tinted(rng, float(rng.uniform(25.0, 210.0)), 0.3),
    )  # fmt: skip


def _tissue(scene: CameraScene, variety: SceneVariety, framing: Framing, rng: np.random.Generator) -> TissueAppearance:
    """Draws whether a rim hides the indentation, and whether and by which means the tissue is hidden from view."""
    tissue = replace(scene.tissue, face_radius_m=framing.face_radius_m)
    if rng.random() < variety.rim_share:
        tissue = replace(tissue, rim_m=float(rng.uniform(*variety.rim_m)), over_tip=True)
    if rng.random() >= variety.hidden_share:
        return tissue
    means = ["in fluid", "of the ground's grey"]
    if framing.behind_m <= variety.most_behind_m:
        # Four equally likely means. If the image's border cannot hide the tissue, the plate takes its share.
        means += ["behind a plate", "cropped" if _crop_axis(framing) else "behind a plate"]
    visibility = means[int(rng.integers(len(means)))]
    tissue = replace(tissue, visibility=visibility)
    if visibility == "in fluid":
        return replace(tissue, opacity=float(rng.uniform(*variety.fluid_opacity)))
    if visibility == "of the ground's grey":
        level = float(np.dot(scene.ground.colour, (0.299, 0.587, 0.114)))
        return replace(tissue, colour=scene.ground.colour, plate_grey=level, body_grey=level, arm_grey=level)
    return tissue


def _cover_plate(framing: Framing, rng: np.random.Generator) -> CoverPlate:
    """Draws a plate whose edge is at the tissue's face when the tissue has come farthest against the tip."""
    across = np.array([-framing.forward[1], framing.forward[0]])
    edge = framing.face_m * framing.forward + framing.aside_m * across
    turn = math.atan2(framing.forward[1], framing.forward[0])
    half = float(rng.uniform(28e-3, 45e-3))
    return CoverPlate((float(edge[0]), float(edge[1])), turn, half, tinted(rng, float(rng.uniform(30, 215)), 0.2))


_STRAIGHT_ENOUGH = math.cos(math.radians(25.0))


def _crop_axis(framing: Framing) -> str:
    """Returns the border beyond which the tissue can be: "far" from the base, "left" or "right" of its tangent, ""."""
    along, across = (float(x) for x in framing.forward)
    if along > _STRAIGHT_ENOUGH:
        return "far"
    return "" if abs(across) < _STRAIGHT_ENOUGH else ("left" if across > 0.0 else "right")


_FRAMES = 30
_TURN = {"left": 0.0, "right": math.pi, "bottom": math.pi / 2, "top": -math.pi / 2}


def _frame(
    lens: Lens, variety: SceneVariety, framing: Framing, cropped: bool, rng: np.random.Generator
) -> tuple[Lens, float]:
    """Draws position and scale of the lens as a person sets it up who wants the whole catheter in view.

    It is drawn again, up to `_FRAMES` times, if the tilted camera does not show all of the catheter. ``cropped``:
    whether the tissue is to be beyond the border. Returns the lens, and how far in m the base is inside the border.
    """
    width, height = framing.size
    upright = framing.base_side in ("top", "bottom")
    px_along, px_across = (height, width) if upright else (width, height)
    low, high = framing.reach_m.min(axis=0)[:2], framing.reach_m.max(axis=0)[:2]
    margin_m = variety.margin_m
    crop = _crop_axis(framing) if cropped else ""
    tangent_rad = _TURN[framing.base_side]
    blur_factor = 640.0 / width  # `Lens` states its blur for 640 columns
    found, inset_m = lens, 0.0
    for _ in range(_FRAMES):
        inset_m = float(rng.uniform(*variety.sheath_m))
        ahead_m = framing.face_m if crop == "far" else high[0] + margin_m
        # The smallest scale (m/px) at which the catheter fits into the image in both directions.
        least_scale = max((inset_m + ahead_m) / px_along, (high[1] - low[1] + 2.0 * margin_m) / px_across)
        least_scale = max(least_scale, variety.scale_m_per_px[0])
        scale = float(rng.uniform(least_scale, max(least_scale, variety.scale_m_per_px[1])))
        if crop == "far":
            scale = least_scale  # the border is at the tissue's face
            inset_m = scale * px_along - ahead_m
        half_field_m = 0.5 * scale * px_across
        # Shift of the base across its tangent; all of the catheter stays inside the margins.
        aside_m = float(rng.uniform(margin_m - half_field_m - low[1], half_field_m - margin_m - high[1]))
        if crop == "left":
            aside_m = half_field_m - framing.face_m
        elif crop == "right":
            aside_m = framing.face_m - half_field_m
        tangent = np.array([math.cos(tangent_rad), -math.sin(tangent_rad)])  # right, down
        normal = np.array([-math.sin(tangent_rad), -math.cos(tangent_rad)])
        middle_m = np.array([0.5 * scale * width, 0.0])
        base_m = middle_m + (inset_m - 0.5 * scale * px_along) * tangent + aside_m * normal
        found = replace(
            lens,
            scale_m_per_px=scale * width / 640.0,
            distance_m=float(rng.uniform(*variety.distance_over_field)) * scale * max(width, height),
            base_at_m=(float(base_m[0]), float(base_m[1])),
            blur_px=lens.blur_px * blur_factor,
            defocus_px_per_m=lens.defocus_px_per_m * blur_factor,
        )
        seen_px = found.camera(width, height).project(framing.reach_m[framing.reach_m[:, 0] > margin_m])
        if crop or ((seen_px > 0.0) & (seen_px < (width - 1.0, height - 1.0))).all():
            break
    return found, inset_m
