"""From shapes in space to the camera's image, and to what that image shows of the catheter."""

import threading

import cv2
import numpy as np
import numpy.typing as npt

from ....geometry import CameraModel
from ....types import FloatArray, Image
from .._exposure import PictureTruth, TissueHome, TissueState, instants
from ._compositing import Desk, compose, draw_tube, lay_phantom
from ._scene import CameraScene
from ._sensor_noise import add_noise, frame_key
from ._static_layers import Painted, paint
from ._tube_model import instrument_shape

__all__ = ["CameraRenderer", "picture_truth"]


class CameraRenderer:
    """Draws the pictures of one session; its methods may be called from several threads at once.

    ``camera`` sees the base frame (metres: x along the base's tangent, y to the left of it, z to the camera); it is
    usually ``scene.camera(width, height)``, which is taken where none is given. ``length_m``: of the catheter, base to
    apex. ``tissue``: where the phantom is at rest, or None without one. The same scene, camera, shapes and frame number
    give the same bytes on any thread and in any order.

    Shapes are (m, n, 3): the catheter's axis from base to apex, uniform in arc length, at instants evenly spread over
    the exposure, the first at its start and the last at its end; m = 1: nothing moves. The shutter is global.
    """

    def __init__(
        self,
        scene: CameraScene,
        length_m: float,
        *,
        camera: CameraModel | None = None,
        tissue: TissueHome | None = None,
        width: int = 640,
        height: int = 480,
    ) -> None:
        self.scene = scene
        self.camera = scene.camera(width, height) if camera is None else camera
        self._painted = paint(scene, self.camera, length_m, tissue, width, height)
        self._desks = threading.local()

    def render(
        self, shapes_m: FloatArray, tissue: TissueState | None = None, *, frame: int = 0, time_s: float = 0.0
    ) -> Image:
        """(h, w, 3) RGB or (h, w) grey picture. ``frame`` picks the noise; ``time_s``: of the instrument's sway."""
        desk, noise = self._composed(shapes_m, tissue, time_s), self.scene.noise
        key = frame_key(self.scene.seed, frame)
        add_noise(desk.clean, key, self._painted.gauss, noise.grey_per_electron, noise.read_grey, desk.planes)
        return desk.planes[0].copy() if len(desk.planes) == 1 else np.asarray(cv2.merge(list(desk.planes)), np.uint8)

    def clean(
        self, shapes_m: FloatArray, tissue: TissueState | None = None, *, time_s: float = 0.0
    ) -> npt.NDArray[np.float32]:
        """(h, w, 3) or (h, w): the light that `render` adds noise to, grey levels, neither rounded nor clipped."""
        desk = self._composed(shapes_m, tissue, time_s)
        return desk.clean[0].copy() if len(desk.clean) == 1 else np.asarray(cv2.merge(list(desk.clean)), np.float32)

    def truth(self, shapes_m: FloatArray, tissue: TissueState | None = None, *, time_s: float = 0.0) -> PictureTruth:
        """What there is to be seen of the catheter in that picture."""
        return picture_truth(self._painted, self._desk(), shapes_m, tissue, time_s)

    def _composed(self, shapes_m: FloatArray, tissue: TissueState | None, time_s: float) -> Desk:
        desk = self._desk()
        compose(self._painted, desk, shapes_m, tissue, time_s)
        return desk

    def _desk(self) -> Desk:
        desk = getattr(self._desks, "desk", None)
        if desk is None:
            desk = self._desks.desk = Desk.for_pictures_of(self._painted)
        return desk


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
