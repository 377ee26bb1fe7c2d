"""From shapes in space to the camera's image, and to the visible catheter in it."""

import threading

import cv2
import numpy as np
import numpy.typing as npt

from ....geometry import CameraModel
from ....types import FloatArray, Image
from .._exposure import ImageTruth, TissueHome, TissueState, sample_exposure
from ._compositing import Buffers, compose, draw_tube, lay_phantom
from ._pipeline import develop
from ._scene import CameraScene
from ._sensor_noise import add_noise, frame_key
from ._static_layers import StaticLayers, make_static_layers
from ._tube_model import instrument_shape


class CameraRenderer:
    """Draws the images of one session; several threads may call its methods at the same time.

    The same scene, camera, shapes and frame number give the same bytes on any thread and in any order.

    Shapes are (m, n, 3): the catheter's axis from base to apex, uniform in arc length, at instants evenly spread over
    the exposure, the first at its start and the last at its end; m = 1: nothing moves. The shutter is global.

    Args:
        scene: the scene.
        length_m: length of the catheter, base to apex.
        camera: camera model whose world is the base frame (x along the base's tangent, y to the left of it, z to the
            camera); None: that of the scene.
        tissue: phantom at rest; None: no phantom.
        width: width of the image in px.
        height: height of the image in px.
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
        """Paints all that does not move."""
        self.scene = scene
        self.camera = scene.camera(width, height) if camera is None else camera
        self._layers = make_static_layers(scene, self.camera, length_m, tissue, width, height)
        self._thread_local = threading.local()

    def render(
        self, shapes_m: FloatArray, tissue: TissueState | None = None, *, frame: int = 0, time_s: float = 0.0
    ) -> Image:
        """Draws an image.

        Args:
            shapes_m: (m, n, 3) axis of the catheter.
            tissue: position of the tissue; None: no tissue is drawn.
            frame: number of the frame, which determines the noise.
            time_s: time that determines the sway of the second instrument.

        Returns:
            (h, w, 3) RGB or (h, w) grey image.
        """
        buffers, noise = self._composed(shapes_m, tissue, time_s), self.scene.noise
        key = frame_key(self.scene.seed, frame)
        if self.scene.pipeline is not None:
            return develop(buffers.clean, self.scene.pipeline, noise, key, self._layers.gauss)
        add_noise(buffers.clean, key, self._layers.gauss, noise.grey_per_electron, noise.read_grey, buffers.planes)
        planes = buffers.planes
        return planes[0].copy() if len(planes) == 1 else np.asarray(cv2.merge(list(planes)), np.uint8)

    def clean(
        self, shapes_m: FloatArray, tissue: TissueState | None = None, *, time_s: float = 0.0
    ) -> npt.NDArray[np.float32]:
        """Draws the light of an image, to which `render` adds noise.

        Args:
            shapes_m: (m, n, 3) axis of the catheter.
            tissue: position of the tissue; None: no tissue is drawn.
            time_s: time that determines the sway of the second instrument.

        Returns:
            (h, w, 3) or (h, w) grey levels, neither rounded nor clipped.
        """
        planes = self._composed(shapes_m, tissue, time_s).clean
        return planes[0].copy() if len(planes) == 1 else np.asarray(cv2.merge(list(planes)), np.float32)

    def truth(self, shapes_m: FloatArray, tissue: TissueState | None = None, *, time_s: float = 0.0) -> ImageTruth:
        """Returns the visible catheter in the image that `render` draws of the same arguments.

        Args:
            shapes_m: (m, n, 3) axis of the catheter.
            tissue: position of the tissue; None: no tissue is drawn.
            time_s: time that determines the sway of the second instrument.

        Returns:
            The truth at the middle of the exposure.
        """
        return image_truth(self._layers, self._buffers(), shapes_m, tissue, time_s)

    def _composed(self, shapes_m: FloatArray, tissue: TissueState | None, time_s: float) -> Buffers:
        buffers = self._buffers()
        compose(self._layers, buffers, shapes_m, tissue, time_s)
        return buffers

    def _buffers(self) -> Buffers:
        buffers = getattr(self._thread_local, "buffers", None)
        if buffers is None:
            buffers = self._thread_local.buffers = Buffers.for_layers(self._layers)
        return buffers


def image_truth(
    layers: StaticLayers, buffers: Buffers, shapes_m: FloatArray, tissue: TissueState | None, time_s: float
) -> ImageTruth:
    """Returns the truth of the image that `compose` makes of the same arguments.

    Args:
        layers: static layers of the session.
        buffers: buffers of this thread.
        shapes_m: (m, n, 3) axis of the catheter at m instants evenly spread over the exposure, base frame.
        tissue: position of the tissue; None: no tissue is drawn.
        time_s: time that determines the sway of the second instrument.

    Returns:
        The visible catheter at the middle of the exposure.
    """
    shape = sample_exposure(shapes_m, 1)
    h, w = layers.light.shape
    passing = _left_in_front(layers, buffers, tissue, time_s)
    box = draw_tube(buffers, layers.catheter, layers.catheter.nodes(shape, layers.camera, layers.focus))
    rows, columns = slice(box[0], box[1]), slice(box[2], box[3])
    mask = np.zeros((h, w), np.bool_)
    mask[rows, columns] = (buffers.drawn[rows, columns, 0] > 0.5) & (passing[rows, columns] > 0.5)
    buffers.drawn[rows, columns] = 0.0
    centreline = layers.camera.project(shape[0])
    nearest_px = np.rint(np.nan_to_num(centreline, nan=-9.0)).astype(int)
    inside = (nearest_px >= 0) & (nearest_px < (w, h))
    visible = inside[:, 0] & inside[:, 1]
    visible[visible] = passing[nearest_px[visible, 1], nearest_px[visible, 0]] > 0.5
    weight = np.ones(len(visible))
    weight[[0, -1]] = 0.5  # an end node has half a step of the length
    return ImageTruth(mask, centreline, visible, float(visible @ weight / weight.sum()))


def _left_in_front(
    layers: StaticLayers, buffers: Buffers, tissue: TissueState | None, time_s: float
) -> npt.NDArray[np.float32]:
    """Returns the share (h, w) of the catheter's light that passes the objects in front of it."""
    scene = layers.scene
    passing = np.ones(layers.light.shape, np.float32) if layers.foreground is None else layers.foreground[-1].copy()
    instrument, second = scene.instrument, layers.second
    if second is not None and instrument is not None and instrument.in_front:
        shape = instrument_shape(scene, instrument, time_s)[None]
        box = draw_tube(buffers, second, second.nodes(shape, layers.camera, layers.focus))
        rows, columns = slice(box[0], box[1]), slice(box[2], box[3])
        passing[rows, columns] *= 1.0 - np.clip(buffers.drawn[rows, columns, 0], 0.0, 1.0)
        buffers.drawn[rows, columns] = 0.0
    if layers.phantom is not None and tissue is not None and scene.tissue.over_tip:
        # A sprite without own light: composed over ``left``, it leaves the share that passes the tissue.
        sprite = layers.phantom.sprite[:, :, -1:].repeat(2, axis=2)
        sprite[:, :, 0] = 0.0
        still = TissueState(sample_exposure(tissue.shift_m[:, None], 1)[:, 0])
        lay_phantom(passing[None], layers, sprite, still)
    return passing
