"""What is to be seen of the catheter in a picture, exactly."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ....types import BoolArray, FloatArray
from ._compose import Desk, TissueState, draw_tube, lay_phantom
from ._paint import Painted
from ._project import instants
from ._tubes import instrument_shape

__all__ = ["PictureTruth", "picture_truth"]


@dataclass(frozen=True, slots=True, eq=False)
class PictureTruth:
    """What is to be seen of the catheter at mid-exposure.

    ``mask`` (h, w): pixels of which the catheter covers more than half while nothing covers the catheter.
    ``centreline_px`` (n, 2): the axis, projected through the lens, at the shape's own nodes, base to the tip's apex;
    pixel centres at integers. The middle between the two outlines lies within 0.005 px of it (perspective shows a
    little more of the tube's far side). ``visible`` (n,): whether a node is in the picture with nothing in front;
    ``visible_share``: the share of the length of which that is true.
    """

    mask: BoolArray
    centreline_px: FloatArray
    visible: BoolArray
    visible_share: float


def picture_truth(
    painted: Painted, desk: Desk, shapes_m: FloatArray, tissue: TissueState | None, time_s: float
) -> PictureTruth:
    """Truth of the picture that `compose` makes of the same arguments."""
    shape = instants(shapes_m, 1)
    h, w = painted.light.shape
    left = _left_in_front(painted, desk, tissue, time_s)
    box = draw_tube(desk, painted.catheter, painted.catheter.nodes(shape, painted.camera, painted.focus))
    rows, columns = slice(box[0], box[1]), slice(box[2], box[3])
    mask = np.zeros((h, w), np.bool_)
    mask[rows, columns] = (desk.drawn[rows, columns, 0] > 0.5) & (left[rows, columns] > 0.5)
    desk.drawn[rows, columns] = 0.0
    centreline = painted.camera.project(shape[0])
    near = np.rint(np.nan_to_num(centreline, nan=-9.0)).astype(int)
    inside = (near >= 0) & (near < (w, h))
    visible = inside[:, 0] & inside[:, 1]
    visible[visible] = left[near[visible, 1], near[visible, 0]] > 0.5
    weight = np.ones(len(visible))
    weight[[0, -1]] = 0.5
    return PictureTruth(mask, centreline, visible, float(visible @ weight / weight.sum()))


def _left_in_front(painted: Painted, desk: Desk, tissue: TissueState | None, time_s: float) -> npt.NDArray[np.float32]:
    """(h, w): share of the catheter's light that comes past all that may stand in front of it."""
    scene = painted.scene
    left = np.ones(painted.light.shape, np.float32) if painted.front is None else painted.front[-1].copy()
    instrument, second = scene.instrument, painted.second
    if second is not None and instrument is not None and instrument.in_front:
        shape = instrument_shape(scene, instrument, time_s)[None]
        box = draw_tube(desk, second, second.nodes(shape, painted.camera, painted.focus))
        rows, columns = slice(box[0], box[1]), slice(box[2], box[3])
        left[rows, columns] *= 1.0 - np.clip(desk.drawn[rows, columns, 0], 0.0, 1.0)
        desk.drawn[rows, columns] = 0.0
    if painted.phantom is not None and tissue is not None and scene.tissue.over_tip:
        sprite = painted.phantom.sprite[:, :, -1:].repeat(2, axis=2)
        sprite[:, :, 0] = 0.0
        still = TissueState(instants(tissue.shift_m[:, None], 1)[:, 0])
        lay_phantom(left[None], painted, sprite, still)
    return left
