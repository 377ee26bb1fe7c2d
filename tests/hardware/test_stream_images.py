"""Images of a camera at an address, and of a webcam: the same rules as for a video file."""

from collections.abc import Callable, Iterable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from tipforce.errors import DeviceError, InputError
from tipforce.hardware import OpenCvCamera, OpenCvCameraConfig, Video, VideoConfig, read_devices
from tipforce.io import open_source
from tipforce.types import Frame, Image

WIDTH, HEIGHT, RATE = 64, 48, 25
COUNT = 500
"""Images of a stream, of which FFmpeg uses up some 250 to find out what it is."""


class SteppingClock:
    """Each question takes 10 ms: what reads a file as fast as it can takes it for a camera."""

    def __init__(self) -> None:
        self._now_ns = 10**9

    def now_ns(self) -> int:
        self._now_ns += 10_000_000
        return self._now_ns

    def sleep_until_ns(self, when_ns: int) -> None:
        self._now_ns = max(self._now_ns, when_ns)


def bar(time_s: float) -> Image:
    """(48, 64, 3): a bright bar that moves by 50 pixels a second and comes back."""
    image = np.full((HEIGHT, WIDTH, 3), 30, np.uint8)
    left = 2 + round(abs((50.0 * time_s) % 96.0 - 48.0))
    image[:, left : left + 8] = 220
    return image


def woven(number: int) -> Image:
    """A frame of two fields: even rows of one instant, odd rows of half a frame period later."""
    image = bar(number / RATE)
    image[1::2] = bar((number + 0.5) / RATE)[1::2]
    return image


def write(
    path: Path, images: Iterable[Image], prepare: Callable[[av.VideoStream], object] = lambda _: None,
    pixels: str = "yuv420p", given: str = "rgb24", codec: str = "libx264",
) -> Path:  # fmt: skip
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=RATE)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, pixels
        prepare(stream)
        for number, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(image, format=given)
            frame.pts, frame.time_base = number, Fraction(1, RATE)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def streamed(path: Path, count: int = 3, **config: object) -> list[Frame]:
    """Images of the file, which is read as a stream from an address."""
    driver = Video(VideoConfig.model_validate({"source": f"file://{path}", **config}))
    try:
        driver.connect(SteppingClock())
        frames: list[Frame] = []
        while len(frames) < count:
            frames += driver.read(0.1)
        return frames
    finally:
        driver.close()


def mirrored(stream: av.VideoStream) -> None:
    stream.set_display_matrix([-1 << 16, 0, 0, 0, 1 << 16, 0, 0, 0, 1 << 30])


def turned(stream: av.VideoStream) -> None:
    stream.set_display_matrix([0, 1 << 16, 0, -1 << 16, 0, 0, 0, 0, 1 << 30])


def wide_pixels(stream: av.VideoStream) -> None:
    stream.codec_context.sample_aspect_ratio = Fraction(4, 3)


@pytest.mark.parametrize("prepare", [mirrored, turned, wide_pixels])
def test_a_stream_is_shown_as_a_file_is(tmp_path: Path, prepare: Callable[[av.VideoStream], object]) -> None:
    path = write(tmp_path / "v.mkv", [bar(0.2)] * COUNT, prepare)
    from_file = next(event for event in open_source(path) if isinstance(event, Frame))
    assert from_file.image.shape != (HEIGHT, WIDTH, 3) or prepare is mirrored
    np.testing.assert_array_equal(streamed(path)[0].image, from_file.image)
    assert streamed(path, grey=True)[0].image.shape == from_file.image.shape[:2]


def test_a_stream_that_turns_by_another_angle_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "v.mkv", [bar(0.2)] * COUNT, lambda stream: stream.set_display_rotation(30.0))
    with pytest.raises(DeviceError, match="turns by another angle than 90, 180 or 270 degrees"):
        streamed(path)


def test_a_stream_of_sixteen_bits_that_states_no_depth_is_refused(tmp_path: Path) -> None:
    deep = [bar(0.2)[..., 0].astype(">u2") << 4] * COUNT
    path = write(tmp_path / "v.mov", deep, pixels="gray16be", given="gray16be", codec="png")
    with pytest.raises(
        DeviceError, match="16 bits and does not state how many of them are in use; set the camera to 8"
    ):
        streamed(path)


def test_a_stream_of_two_instants_in_a_frame_is_refused_and_the_advice_helps(tmp_path: Path) -> None:
    path = write(tmp_path / "v.mkv", [woven(number) for number in range(COUNT)])
    with pytest.raises(
        DeviceError, match=r"two instants \(interlaced\).*hardware\.cameras\.camera\.deinterlace = true"
    ):
        streamed(path, count=100)
    for frame in streamed(path, count=100, deinterlace=True):
        columns = (frame.image[..., 1] > 120).sum(axis=0)
        assert set(np.unique(columns)) <= {0, HEIGHT}  # one bar with straight edges: one instant


def test_a_progressive_stream_is_never_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "v.mkv", [bar(number / RATE) for number in range(COUNT)])
    assert len(streamed(path, count=150)) == 150


class Webcam:
    """A capture of OpenCV."""

    def __init__(self, image: Callable[[int], Image]) -> None:
        self.image, self.number = image, -1

    def isOpened(self) -> bool:
        return True

    def set(self, name: int, value: float) -> bool:
        return True

    def get(self, name: int) -> float:
        return -1.0

    def read(self) -> tuple[bool, Image]:
        self.number += 1
        return True, self.image(self.number)

    def release(self) -> None:
        pass


def frames_of(camera: OpenCvCamera) -> list[Frame]:
    return [event for _ in range(100) for event in camera.read(0.1) if isinstance(event, Frame)]


def test_a_webcam_of_two_instants_in_a_frame_is_refused_and_the_advice_helps() -> None:
    camera = OpenCvCamera(OpenCvCameraConfig(device=0), open_capture=lambda *_: Webcam(woven))
    camera.connect(SteppingClock())
    with pytest.raises(
        DeviceError, match=r"two instants \(interlaced\).*hardware\.cameras\.camera\.deinterlace = true"
    ):
        frames_of(camera)
    camera = OpenCvCamera(OpenCvCameraConfig(device=0, deinterlace=True), open_capture=lambda *_: Webcam(woven))
    camera.connect(SteppingClock())
    frames = frames_of(camera)
    assert len(frames) > 20
    assert {int(n) for frame in frames for n in np.unique((frame.image[..., 1] > 120).sum(axis=0))} <= {0, HEIGHT}


def test_deinterlace_is_refused_for_a_file(tmp_path: Path) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text('[hardware.cameras.camera]\ndriver = "video"\nsource = "a.mp4"\ndeinterlace = true\n')
    with pytest.raises(InputError, match=r"hardware\.cameras\.camera\.deinterlace = True is refused: .*for streams"):
        read_devices(bench)
