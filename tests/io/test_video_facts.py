"""What a container or codec states of its images is honoured or refused with a remedy."""

import re
import warnings
from collections.abc import Callable, Iterable
from fractions import Fraction
from pathlib import Path

import av
import av.filter
import numpy as np
import pytest
from av.stream import Disposition

from tipforce.errors import FileFormatError
from tipforce.io import frame_count, open_source
from tipforce.io.video._pixels import levels_of
from tipforce.types import Frame, IntArray

WIDTH, HEIGHT = 64, 48
Prepare = Callable[[av.VideoStream], None]


def corner_image() -> np.ndarray:
    """(48, 64, 3): bright, with the top left quarter dark."""
    image = np.full((HEIGHT, WIDTH, 3), 200, np.uint8)
    image[: HEIGHT // 2, : WIDTH // 2] = 40
    return image


def write(
    path: Path, images: Iterable[np.ndarray], codec: str = "libx264", pixels: str = "yuv420p", *, given: str = "rgb24",
    prepare: Prepare | None = None, rate: int = 25, **options: str,
) -> Path:  # fmt: skip
    """A video at ``rate`` images a second."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate, options=options)
        for number, image in enumerate(images):
            if number == 0:
                size = image.shape[1:] if given == "yuv444p" else image.shape[:2]
                stream.height, stream.width, stream.pix_fmt = *size, pixels
                if prepare:
                    prepare(stream)
            frame = av.VideoFrame.from_ndarray(image, format=given)
            frame.pts, frame.time_base = number, Fraction(1, rate)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def frames_of(path: Path) -> list[Frame]:
    return [event for event in open_source(path) if isinstance(event, Frame)]


def filtered(path: Path, chain: str, target: Path) -> Path:
    """What ``ffmpeg -i path -vf chain target`` writes."""
    images, stamps = [], []
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        graph = av.filter.Graph()
        last = graph.add_buffer(template=stream)
        for each in chain.split(","):
            name, _, arguments = each.partition("=")
            following = graph.add(name, arguments)
            last.link_to(following)
            last = following
        last.link_to(graph.add("buffersink"))
        graph.configure()
        for frame in [*container.decode(stream), None]:
            graph.push(frame)
            while True:
                try:
                    found = graph.pull()
                except (av.error.BlockingIOError, av.error.EOFError):
                    break
                images.append(found.to_ndarray(format="rgb24"))
                stamps.append(found.pts * found.time_base)
    return write(target, images, rate=round(1 / (stamps[1] - stamps[0])))


def advised_filter(message: str) -> str:
    """The filters of the ffmpeg line in a message."""
    found = re.search(r"-vf (\S+)", message)
    assert found, message
    return found[1]


MATRICES = {
    "as stored": ((1, 0, 0, 1), lambda image: image),
    "turned by 90": ((0, 1, -1, 0), lambda image: np.rot90(image, -1)),
    "turned by 180": ((-1, 0, 0, -1), lambda image: np.rot90(image, 2)),
    "turned by 270": ((0, -1, 1, 0), lambda image: np.rot90(image, 1)),
    "mirrored": ((-1, 0, 0, 1), lambda image: image[:, ::-1]),
    "upside down": ((1, 0, 0, -1), lambda image: image[::-1]),
    "transposed": ((0, 1, 1, 0), lambda image: np.swapaxes(image, 0, 1)),
    "transposed the other way": ((0, -1, -1, 0), lambda image: np.swapaxes(image[::-1, ::-1], 0, 1)),
}


def display(matrix: tuple[int, int, int, int]) -> Prepare:
    a, b, c, d = (element << 16 for element in matrix)
    return lambda stream: stream.set_display_matrix([a, b, 0, c, d, 0, 0, 0, 1 << 30])


@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
@pytest.mark.parametrize("name", MATRICES)
def test_a_video_is_turned_and_mirrored_as_its_display_matrix_says(tmp_path: Path, name: str, suffix: str) -> None:
    matrix, shown = MATRICES[name]
    path = write(tmp_path / f"v.{suffix}", [corner_image()] * 3, prepare=display(matrix))
    image = frames_of(path)[0].image
    wanted = shown(corner_image())
    assert image.shape == wanted.shape
    assert np.abs(image.astype(int) - wanted)[..., 1].max() < 30


def test_a_display_matrix_that_turns_by_another_angle_is_refused_with_a_remedy(tmp_path: Path) -> None:
    def slanted(stream: av.VideoStream) -> None:
        stream.set_display_rotation(30.0)

    path = write(tmp_path / "v.mp4", [corner_image()] * 3, prepare=slanted)
    with pytest.raises(FileFormatError, match=r"by another angle than 90, 180 or 270 degrees; .*ffmpeg -i VIDEO"):
        frames_of(path)


@pytest.mark.parametrize(
    ("aspect", "shape"),
    [(Fraction(4, 3), (48, 85)), (Fraction(8, 9), (54, 64)), (Fraction(1000, 1001), (48, 64)), (Fraction(1), (48, 64))],
)
def test_pixels_that_are_not_square_are_stretched_until_they_are(
    tmp_path: Path, aspect: Fraction, shape: tuple[int, int]
) -> None:
    def state(stream: av.VideoStream) -> None:
        stream.codec_context.sample_aspect_ratio = aspect

    found = frames_of(write(tmp_path / "v.mp4", [corner_image()] * 3, prepare=state))
    assert {frame.image.shape[:2] for frame in found} == {shape}
    height, width = shape
    assert found[0].image[: height // 2 - 3, : width // 2 - 3].max() < 80
    assert found[0].image[height // 2 + 3 :, width // 2 + 3 :].min() > 160


def test_an_aspect_of_nonsense_is_refused_and_its_remedy_helps(tmp_path: Path) -> None:
    def state(stream: av.VideoStream) -> None:
        stream.codec_context.sample_aspect_ratio = Fraction(9, 1)

    path = write(tmp_path / "v.mp4", [corner_image()] * 3, prepare=state)
    with pytest.raises(FileFormatError, match="states pixels of 9 : 1, at most 4 : 1 are read") as caught:
        frames_of(path)
    mended = filtered(path, advised_filter(str(caught.value)), tmp_path / "square.mp4")
    assert frames_of(mended)[0].image.shape == (48, 64, 3)


def bar_at(time_s: float) -> np.ndarray:
    """(96, 128, 3) of a bright bar that goes to and fro before dark noise."""
    noise = np.random.default_rng(round(time_s * 1000)).normal(0.0, 3.0, (96, 128))
    image = 60.0 + noise
    left = bar_left(time_s)
    image[10:86, left : left + 16] += 120.0
    return np.repeat(np.clip(image, 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def bar_left(time_s: float) -> int:
    return round(50.0 + 40.0 * np.sin(2.0 * np.pi * 0.8 * time_s))


def woven(even_first: bool, count: int = 25) -> list[np.ndarray]:
    """Frames at 25 Hz whose rows were taken at two instants, 20 ms apart."""
    images = []
    for number in range(count):
        image, other = bar_at(number / 25), bar_at((number + 0.5) / 25)
        image[int(even_first) :: 2] = other[int(even_first) :: 2]
        images.append(image)
    return images


def bar_positions(frames: list[Frame]) -> np.ndarray:
    """Left edge of the bar in px, by the mean of the columns in which rows in the middle are bright."""
    return np.array([np.flatnonzero(frame.image[20:76, :, 1].mean(axis=0) > 120).mean() - 7.5 for frame in frames])


CODINGS = {
    "upper field first": ("libx264", {"x264-params": "tff=1"}, "v.mp4"),
    "lower field first": ("libx264", {"x264-params": "bff=1"}, "v.mp4"),
    "mpeg2": ("mpeg2video", {"flags": "+ilme+ildct", "b": "4M"}, "v.mpg"),
}


@pytest.mark.parametrize("even_first", [True, False])
@pytest.mark.parametrize("coding", CODINGS)
def test_each_field_of_an_interlaced_video_is_an_image_with_its_own_stamp(
    tmp_path: Path, coding: str, even_first: bool
) -> None:
    """Also where the file states the wrong order of the fields."""
    codec, options, name = CODINGS[coding]
    path = write(tmp_path / name, woven(even_first), codec, **options)
    with pytest.warns(UserWarning, match="is interlaced: each frame is read as two images"):
        source = open_source(path)
    found = [event for event in source if isinstance(event, Frame)]
    assert len(found) == 50
    assert frame_count(source) == pytest.approx(50, abs=2)
    assert {frame.image.shape for frame in found} == {(96, 128, 3)}
    seconds = np.array([frame.stamp_ns - found[0].stamp_ns for frame in found]) * 1e-9
    np.testing.assert_allclose(seconds, np.arange(50) / 50, atol=2e-3)
    expected = np.array([bar_left(number / 50) for number in range(50)])
    assert np.abs(bar_positions(found)[2:-2] - expected[2:-2]).max() < 1.5


def test_after_a_gap_a_field_keeps_half_a_frame_period_from_its_frame(tmp_path: Path) -> None:
    path = tmp_path / "v.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25, options={"x264-params": "tff=1", "bf": "0"})
        stream.width, stream.height, stream.pix_fmt = 128, 96, "yuv420p"
        for number, image in enumerate(woven(even_first=True)):
            frame = av.VideoFrame.from_ndarray(image, format="rgb24")
            frame.pts, frame.time_base = number + (25 if number >= 12 else 0), Fraction(1, 25)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    with pytest.warns(UserWarning, match="is interlaced"):
        stamps: IntArray = np.array([frame.stamp_ns for frame in frames_of(path)])
    steps = np.diff(stamps) * 1e-9
    assert len(stamps) == 50
    assert steps[23] == pytest.approx(1.02, abs=2e-3)
    np.testing.assert_allclose(np.delete(steps, 23), 0.02, atol=2e-3)


def test_frames_of_one_instant_that_are_marked_as_interlaced_are_read_whole(tmp_path: Path) -> None:
    images = [bar_at(number / 25) for number in range(25)]
    path = write(tmp_path / "v.mp4", images, **{"x264-params": "tff=1"})
    with pytest.warns(UserWarning, match="both fields of a frame show one instant: its frames are read whole"):
        found = frames_of(path)
    assert len(found) == 25
    assert np.abs(found[7].image.astype(int) - images[7]).mean() < 4


@pytest.mark.parametrize("even_first", [True, False])
def test_an_interlaced_video_that_is_not_marked_is_refused_and_its_remedy_helps(
    tmp_path: Path, even_first: bool
) -> None:
    path = write(tmp_path / "v.mp4", woven(even_first))
    with pytest.raises(FileFormatError, match="even and odd rows were taken at two instants") as caught:
        frames_of(path)
    mended = filtered(path, advised_filter(str(caught.value)), tmp_path / "fields.mp4")
    found = frames_of(mended)
    assert len(found) == 50
    expected = np.array([bar_left(number / 50) for number in range(50)])
    assert np.abs(bar_positions(found)[2:-2] - expected[2:-2]).max() < 1.5


@pytest.mark.parametrize("moving", [True, False])
def test_a_progressive_video_is_not_taken_for_an_interlaced_one(tmp_path: Path, moving: bool) -> None:
    path = write(tmp_path / "v.mp4", [bar_at(number / 25 if moving else 0.0) for number in range(25)])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(frames_of(path)) == 25


def test_a_cover_is_not_taken_for_the_video(tmp_path: Path) -> None:
    """The cover is stream 0, as in files of some telephones."""
    path = tmp_path / "v.mp4"
    with av.open(str(path), "w") as container:
        cover = container.add_stream("mjpeg", rate=1)
        cover.width, cover.height, cover.pix_fmt = 32, 24, "yuvj420p"
        cover.disposition = Disposition.attached_pic
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for number in range(5):
            for each in (cover, stream)[number > 0 :]:
                frame = av.VideoFrame.from_ndarray(np.full((each.height, each.width, 3), 90, np.uint8), format="rgb24")
                frame.pts, frame.time_base = number, Fraction(1, 25)
                container.mux(each.encode(frame))
        container.mux(cover.encode(None))
        container.mux(stream.encode(None))
    assert [frame.image.shape for frame in frames_of(path)] == [(HEIGHT, WIDTH, 3)] * 5


def two_videos(path: Path, default: int) -> Path:
    """A small video and a large one in a file."""
    with av.open(str(path), "w") as container:
        streams = []
        for size in ((32, 24), (WIDTH, HEIGHT)):
            stream = container.add_stream("libx264", rate=25)
            (stream.width, stream.height), stream.pix_fmt = size, "yuv420p"
            streams.append(stream)
        streams[default].disposition = Disposition.default
        for number in range(5):
            for stream in streams:
                image = np.full((stream.height, stream.width, 3), 90, np.uint8)
                frame = av.VideoFrame.from_ndarray(image, format="rgb24")
                frame.pts, frame.time_base = number, Fraction(1, 25)
                container.mux(stream.encode(frame))
        for stream in streams:
            container.mux(stream.encode(None))
    return path


SIZES = [(24, 32, 3), (HEIGHT, WIDTH, 3)]


@pytest.mark.parametrize("default", [0, 1])
def test_of_two_videos_in_a_file_it_is_said_which_one_is_read_and_how_the_other_is(
    tmp_path: Path, default: int
) -> None:
    path = two_videos(tmp_path / "v.mp4", default)
    with pytest.warns(UserWarning, match=rf"holds 2 videos; stream {default}, .* is read") as said:
        assert frames_of(path)[0].image.shape == SIZES[default]
    wanted = re.search(r"-map 0:(\d+) -c copy", str(said[0].message))
    assert wanted
    with av.open(str(path)) as container, av.open(str(tmp_path / "other.mp4"), "w") as out:
        stream = container.streams[int(wanted[1])]
        copy = out.add_stream_from_template(stream)
        for packet in container.demux(stream):
            if packet.dts is not None:
                packet.stream = copy
                out.mux(packet)
    assert frames_of(tmp_path / "other.mp4")[0].image.shape == SIZES[1 - default]


def test_two_views_in_one_image_are_refused_and_the_remedy_helps(tmp_path: Path) -> None:
    path = write(tmp_path / "v.mp4", [corner_image()] * 3, **{"x264-params": "frame-packing=3"})
    with pytest.raises(FileFormatError, match="two views of a stereo camera, side by side") as caught:
        frames_of(path)
    mended = filtered(path, advised_filter(str(caught.value)), tmp_path / "view.mp4")
    assert frames_of(mended)[0].image.shape == (HEIGHT, WIDTH // 2, 3)


RAMP = np.tile(np.linspace(0, 255, WIDTH).astype(np.uint8), (HEIGHT, 1))
DEPTHS = {
    "8 bits": ("gray", RAMP),
    "10 bits": ("gray10le", RAMP.astype(np.uint16) << 2),
    "12 bits": ("gray12le", RAMP.astype(np.uint16) << 4),
    "12 bits in 16": ("gray16le", RAMP.astype(np.uint16) << 4),
    "16 bits": ("gray16le", RAMP.astype(np.uint16) << 8),
}


@pytest.mark.parametrize("name", DEPTHS)
def test_a_grey_video_of_any_depth_is_read_with_its_brightness(tmp_path: Path, name: str) -> None:
    pixels, image = DEPTHS[name]
    path = write(tmp_path / "v.mkv", [image] * 3, "ffv1", pixels, given=pixels)
    for frame in frames_of(path):
        np.testing.assert_array_equal(frame.image, RAMP)


def test_one_bright_image_decides_the_depth_of_the_whole_video(tmp_path: Path) -> None:
    dim, bright = np.full((HEIGHT, WIDTH), 4000, np.uint16), np.full((HEIGHT, WIDTH), 60000, np.uint16)
    for images, wanted in (([dim, dim], [250, 250]), ([dim, bright, dim], [15, 234, 15])):
        path = write(tmp_path / "v.mkv", images, "ffv1", "gray16le", given="gray16le")
        assert [int(frame.image[0, 0]) for frame in frames_of(path)] == wanted


def test_colours_of_twelve_bits_in_sixteen_are_read_with_their_brightness(tmp_path: Path) -> None:
    image = np.dstack([RAMP, RAMP // 2, RAMP // 4]).astype(np.uint16) << 4
    path = write(tmp_path / "v.mkv", [image] * 2, "ffv1", "gbrp16le", given="rgb48le")
    np.testing.assert_array_equal(frames_of(path)[0].image, np.dstack([RAMP, RAMP // 2, RAMP // 4]))


@pytest.mark.parametrize("limited", [True, False])
@pytest.mark.parametrize("pixels", ["gray", "yuv444p"])
def test_limited_and_full_range_give_the_same_brightness_as_a_still_image(
    tmp_path: Path, pixels: str, limited: bool
) -> None:
    stored = np.rint(16 + RAMP * (219 / 255)).astype(np.uint8) if limited else RAMP
    planes = stored if pixels == "gray" else np.stack([stored, *[np.full_like(stored, 128)] * 2])

    def state(stream: av.VideoStream) -> None:
        stream.codec_context.color_range = 1 if limited else 2

    path = write(tmp_path / "v.mkv", [planes] * 3, "ffv1", pixels, given=pixels, prepare=state)
    image = frames_of(path)[0].image
    assert np.abs((image if image.ndim == 2 else image[..., 0]).astype(int) - RAMP).max() <= 2


def test_a_video_that_changes_its_size_is_refused_where_it_does(tmp_path: Path) -> None:
    path = tmp_path / "v.ts"
    raw = b""
    for number, size in enumerate(((48, 64), (96, 128))):
        part = tmp_path / f"{number}.ts"
        with av.open(str(part), "w") as container:
            stream = container.add_stream("mpeg2video", rate=25)
            stream.height, stream.width, stream.pix_fmt = *size, "yuv420p"
            for place in range(5):
                frame = av.VideoFrame.from_ndarray(np.full((*size, 3), 90, np.uint8), format="rgb24")
                frame.pts, frame.time_base = place + 5 * number, Fraction(1, 25)
                container.mux(stream.encode(frame))
            container.mux(stream.encode(None))
        raw += part.read_bytes()
    path.write_bytes(raw)
    with pytest.raises(FileFormatError, match=r"frame 4, .* has 128 x 96 pixels, those before it 64 x 48"):
        frames_of(path)


def test_frames_that_an_edit_list_hides_are_not_missed(tmp_path: Path) -> None:
    """A telephone trims a video by hiding what stands before the first wanted frame."""
    path = write(tmp_path / "v.mp4", [np.full((HEIGHT, WIDTH, 3), 4 * k, np.uint8) for k in range(40)], bf="0")
    raw = bytearray(path.read_bytes())
    at = raw.find(b"elst") + 8  # version and flags, number of entries stand before the first entry
    count = int.from_bytes(raw[at : at + 4], "big")
    assert count == 1
    duration, start = int.from_bytes(raw[at + 4 : at + 8], "big"), 20 * 512
    raw[at + 4 : at + 12] = (duration // 2).to_bytes(4, "big") + start.to_bytes(4, "big")
    path.write_bytes(raw)
    found = frames_of(path)
    assert len(found) == 20
    assert abs(int(found[0].image[0, 0, 0]) - 80) < 8
    assert found[0].stamp_ns == 0


def test_a_frame_is_converted_by_its_own_range_whatever_was_converted_before() -> None:
    pixels = np.random.default_rng(0).integers(0, 256, 64 * 48 * 3 // 2, dtype=np.uint8).reshape(72, 64)
    for limits in (1, 2, 1, 0, 2):
        frame = av.VideoFrame.from_ndarray(pixels, format="yuv420p")
        frame.color_range = limits
        np.testing.assert_array_equal(levels_of(frame, "video"), frame.to_ndarray(format="rgb24"))
