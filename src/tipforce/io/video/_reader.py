"""Reads video files: every image with its own stamp, as a player shows it."""

import warnings
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import av
import av.error
from av.container import InputContainer
from av.stream import Disposition

from ..._system.cores import cores
from ...errors import FileFormatError, TimeError
from ...types import Frame
from .._image_size import check_pixels, max_pixels
from .._images import bits_in_use
from ._fields import FieldEvidence, FieldOrder, split_fields, stated_order
from ._pixels import grey_of, levels_of, shown_image

_REMEDY = "to use the readable part, cut it out first: ffmpeg -i VIDEO -c copy WHOLE.mp4"
COMPANION_STREAMS = (
    Disposition.attached_pic | Disposition.timed_thumbnails | Disposition.still_image | Disposition.dependent
)
"""Streams that accompany a video: a cover, thumbnails, a depth map."""
MAX_PROBED_FRAMES = 250
"""Number of frames by which a video that is marked as interlaced is checked."""
MIN_READ_SHARE, MIN_WHOLE_SHARE = 0.98, 0.5
"""A file is refused if fewer of its stated frames can be read, or fewer of these are undamaged."""


class VideoFile:
    """A video file that can be read any number of times.

    Raises FileFormatError for a file that is no video, is cut off, or states a property of its images that is not
    supported.
    """

    def __init__(self, path: Path) -> None:
        """Chooses the stream and reads size, number of frames and order of the fields from the file."""
        self.path = path
        self._bits: int | None = None
        self._order: FieldOrder | None = None
        with _opened(path) as container:
            stream = _chosen_stream(path, container)
            self._stream_index = stream.index
            check_pixels(stream.width, stream.height, str(path))
            self._stated_order: FieldOrder = stated_order(stream)
            self._stated_frames = _stated_count(container, stream)
        if self._stated_order != "one instant":
            self._field_order()  # known now, because `frame_count` depends on it

    @property
    def frame_count(self) -> int:
        """Number of images that the file states; 0 where it states none."""
        return self._stated_frames * (1 if self._order in (None, "one instant") else 2)

    def frames(self, view: str = "camera") -> Iterator[Frame]:
        """Yields all images, stamped as mid-exposure: (h, w) grey where the file is grey, else (h, w, 3) RGB.

        They are upright, with square pixels and 8 bits. A frame of two fields becomes two images. Damaged frames, and
        those up to the next key frame, which are made from them, are left out; a warning states their number.

        Raises:
            FileFormatError: the file ends early, is mostly damaged, or its images differ in kind.
            TimeError: stamps are missing, repeated or run backwards.
        """
        with _opened(self.path) as container:
            stream = self._stream(container)
            checked = self._checked(self._unmarked_checked(_undamaged(self.path, container, stream)))
            for stamp_ns, decoded in split_fields(checked, stream, self._field_order):
                yield Frame(stamp_ns, shown_image(decoded, stream, str(self.path), self._bits_in_use), view)

    def _stream(self, container: InputContainer) -> av.VideoStream:
        stream = next(each for each in container.streams.video if each.index == self._stream_index)
        stream.thread_type = "AUTO"
        if cores() == 1:
            stream.codec_context.thread_count = 1
        # a frame may claim another size than the header of the file, which was checked
        stream.codec_context.options = {"max_pixels": str(max_pixels())}
        return stream

    def _decoded(self) -> Iterator[av.VideoFrame]:
        """Yields the undamaged frames of the file, without warnings about its faults."""
        with _opened(self.path) as container:
            yield from (each for each in _Packets(container, self._stream(container)) if each is not None)

    def _bits_in_use(self) -> int:
        """Returns the bits in use in pixels of 16 bits, by the rule for image files: one depth for the whole file."""
        if self._bits is None:
            self._bits = bits_in_use(levels_of(decoded, str(self.path)) for decoded in self._decoded())
        return self._bits

    def _field_order(self) -> FieldOrder:
        """Returns the order of the fields as interlaced frames show it, or the stated one without movement.

        Files often state it wrongly, or mark frames of one instant as interlaced.
        """
        if self._order is None:
            evidence = FieldEvidence()
            for decoded in islice(self._decoded(), MAX_PROBED_FRAMES):
                if decoded.interlaced_frame:
                    evidence.add(grey_of(decoded))
                if evidence.two_instants is not None:
                    break
            order: FieldOrder = self._stated_order
            if evidence.two_instants is False:
                order = "one instant"
                remark = (
                    "is marked as interlaced, but both fields of a frame show one instant: its frames are read whole"
                )
            else:
                if evidence.two_instants or order == "one instant":
                    order = evidence.earlier_field
                remark = "is interlaced: each frame is read as two images, half a frame period apart"
            warnings.warn(f"{self.path}: {remark}", stacklevel=1)
            self._order = order
        return self._order

    def _checked(self, frames: Iterator[tuple[int, av.VideoFrame]]) -> Iterator[tuple[int, av.VideoFrame]]:
        """Yields stamp and image of the frames. Raises FileFormatError at an image of another size."""
        first_size: tuple[int, int] | None = None
        for number, (stamp_ns, decoded) in enumerate(frames):
            width, height = decoded.width, decoded.height
            first_size = first_size or (width, height)
            if (width, height) != first_size:
                raise FileFormatError(
                    f"{self.path}: frame {number}, at {stamp_ns * 1e-9:.3f} s, has {width} x {height} pixels, those "
                    f"before it {first_size[0]} x {first_size[1]}: cut the video there: ffmpeg -i VIDEO -t "
                    f"{stamp_ns * 1e-9:.3f} -c copy FIRST.mp4"
                )
            yield stamp_ns, decoded

    def _unmarked_checked(self, frames: Iterator[tuple[int, av.VideoFrame]]) -> Iterator[tuple[int, av.VideoFrame]]:
        """Yields stamp and image of the frames. Raises FileFormatError where they are interlaced but not marked so."""
        evidence: FieldEvidence | None = FieldEvidence()
        for stamp_ns, decoded in frames:
            yield stamp_ns, decoded
            if evidence is None or decoded.interlaced_frame:
                continue
            evidence.add(grey_of(decoded))
            if evidence.two_instants:
                split = f"setfield={evidence.earlier_field},bwdif=mode=send_field"
                raise FileFormatError(
                    f"{self.path}: its even and odd rows were taken at two instants (interlaced), which the file does "
                    f"not say; make each field an image: ffmpeg -i VIDEO -vf {split} -crf 10 FIELDS.mp4"
                )
            evidence = None if evidence.two_instants is False else evidence


def _reason(error: Exception) -> str:
    return str(error).split("] ", 1)[-1].split(":")[0].strip()


def _opened(path: Path) -> InputContainer:
    """Returns the open file. Raises FileFormatError where it is no video, or an .mp4 that was cut off."""
    if not path.exists():
        raise FileFormatError(f"{path}: there is no such file")
    if path.stat().st_size == 0:
        raise FileFormatError(f"{path}: the file is empty, not a video")
    try:
        container = av.open(str(path), metadata_errors="replace")
    except av.error.FFmpegError as error:
        if path.suffix.lower() in (".mp4", ".mov", ".m4v"):
            raise FileFormatError(
                f"{path}: cannot be opened as a video ({_reason(error)}): an .mp4 whose recording was cut off has no "
                "index; record again, or repair it from an intact file of the same camera"
            ) from None
        raise FileFormatError(f"{path}: is no video that FFmpeg can read ({_reason(error)})") from None
    missing = _missing_bytes(path) if container.format.name.startswith("mov") else 0
    if missing:
        container.close()
        raise FileFormatError(f"{path}: is cut off: its last {missing} bytes are missing; {_REMEDY}")
    return container


def _chosen_stream(path: Path, container: InputContainer) -> av.VideoStream:
    """Returns the stream to read: no cover or thumbnail; of several the default one, else the first of the largest.

    Raises FileFormatError where there is none, or no decoder for it.
    """
    streams = [stream for stream in container.streams.video if not stream.disposition & COMPANION_STREAMS]
    if not streams:
        raise FileFormatError(f"{path}: holds no video stream")
    moving = [stream for stream in streams if stream.frames != 1] or streams  # a stream of one frame is a cover
    usable = [stream for stream in moving if getattr(stream, "codec_context", None)]
    if not usable:
        raise FileFormatError(f"{path}: no decoder here knows its kind of video; convert it, for example to H.264")
    chosen = max(usable, key=lambda each: (bool(each.disposition & Disposition.default), each.width * each.height))
    others = [stream for stream in usable if stream is not chosen]
    if others:
        listed = ", ".join(f"stream {each.index}, {each.width} x {each.height} pixels" for each in others)
        warnings.warn(
            f"{path}: holds {len(usable)} videos; stream {chosen.index}, {chosen.width} x {chosen.height} pixels, is "
            f"read, not {listed}: to read this one, write it to a file of its own: ffmpeg -i VIDEO -map "
            f"0:{others[0].index} -c copy OTHER.mp4",
            stacklevel=1,
        )
    return chosen


def _missing_bytes(path: Path) -> int:
    """Returns the number of bytes by which the boxes of an .mp4 extend beyond the end of the file.

    A box begins with its length (4 bytes, big-endian) and its name (4 bytes).
    """
    size, box_start = path.stat().st_size, 0
    with path.open("rb") as stream:
        while box_start + 8 <= size:
            stream.seek(box_start)
            head = stream.read(16)
            length = int.from_bytes(head[:4], "big")
            if length == 1:  # the length follows the name, in 64 bits
                length = int.from_bytes(head[8:], "big")
            if length < 8:  # 0: the last box extends to the end of the file
                return 0
            box_start += length
    return max(0, box_start - size)


def _stated_count(container: InputContainer, stream: av.VideoStream) -> int:
    """Returns the number of frames that the file states, else duration (in us) times mean rate, else 0."""
    if stream.frames:
        return stream.frames
    rate = stream.average_rate
    return round((container.duration or 0) / 1_000_000 * float(rate)) if rate else 0


def _undamaged(path: Path, container: InputContainer, stream: av.VideoStream) -> Iterator[tuple[int, av.VideoFrame]]:
    """Yields stamp in ns and image of the undamaged frames; see `VideoFile.frames`.

    A frame after a damaged one counts as damaged, too, until a key frame, which is decoded without those before it.
    """
    packets = _Packets(container, stream)
    count, damaged_count, first_damage_s = 0, 0, 0.0
    last: int | None = None  # stamp in ns
    damaged = False
    try:
        for decoded in packets:
            if decoded is None:
                count, damaged = count + 1, True
                first_damage_s = first_damage_s if damaged_count else (last or 0) * 1e-9
                damaged_count += 1
                continue
            if decoded.pts is None or decoded.time_base is None:
                raise TimeError(f"{path}: frame {count} has no time stamp; write the video with time stamps")
            stamp_ns = round(decoded.pts * decoded.time_base * 1_000_000_000)
            if last is not None and stamp_ns <= last:
                fault = "repeats the stamp of" if stamp_ns == last else "is stamped before"
                raise TimeError(
                    f"{path}: frame {count} ({stamp_ns * 1e-9:.6f} s) {fault} the frame before it "
                    f"({last * 1e-9:.6f} s); write the video with rising stamps, or as images with a stamps.csv"
                )
            count, last = count + 1, stamp_ns
            damaged = decoded.is_corrupt or (damaged and not decoded.key_frame)
            if damaged:
                first_damage_s = first_damage_s if damaged_count else stamp_ns * 1e-9
                damaged_count += 1
                continue
            yield stamp_ns, decoded
    except av.error.FFmpegError as error:
        raise FileFormatError(f"{path}: cannot be read beyond frame {count} ({_reason(error)}); {_REMEDY}") from None
    if count == 0:
        raise FileFormatError(f"{path}: not one frame can be read; the video is cut off or damaged")
    stated = stream.frames - packets.hidden
    if stream.frames and count < MIN_READ_SHARE * stated:
        raise FileFormatError(f"{path}: is cut off: {count} of {stated} frames can be read; {_REMEDY}")
    whole_count = count - damaged_count
    if whole_count < MIN_WHOLE_SHARE * count:
        raise FileFormatError(f"{path}: is damaged: {whole_count} of {count} frames are whole; copy it again")
    if damaged_count:
        warnings.warn(
            f"{path}: {damaged_count} damaged frames were left out, the first at {first_damage_s:.3f} s; copy the file "
            "again if it has an intact original",
            stacklevel=1,
        )


class _Packets:
    """Yields the decoded frames of a stream, and None for a packet that cannot be decoded.

    ``hidden``: number of packets until now that the edit list of the file leaves out, as in a trimmed telephone video.
    """

    def __init__(self, container: InputContainer, stream: av.VideoStream) -> None:
        self._container, self._stream = container, stream
        self.hidden = 0

    def __iter__(self) -> Iterator[av.VideoFrame | None]:
        # one packet after the other: otherwise the position of an error depends on the threads of the decoder
        for packet in self._container.demux(self._stream):
            self.hidden += packet.is_discard
            try:
                decoded = packet.decode()
            except av.error.InvalidDataError:
                yield None
            else:
                yield from decoded
