"""From shapes in space to the camera's picture."""

import threading

import cv2
import numpy as np
import numpy.typing as npt

from ....geometry import CameraModel
from ....types import FloatArray, Image
from ._compose import Desk, TissueState, compose
from ._noise import add_noise, frame_key
from ._paint import paint
from ._phantom import TissueHome
from ._scene import CameraScene
from ._truth import PictureTruth, picture_truth

__all__ = ["CameraRenderer"]


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
