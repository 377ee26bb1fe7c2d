"""Emulates a network camera on this machine: motion JPEG by HTTP, which OpenCV and FFmpeg open."""

import threading
import time
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Self

from ...io import encode_image
from ...types import Image

_BOUNDARY = "tipforce"
_POLL_S = 0.02


class CameraEmulator:
    """Emulated camera. ``frozen`` True: it sends no image; ``gone`` True: it accepts no connection.

    Args:
        image: number of the frame -> image.
        fps: images per second.
        port: port that it serves; 0: any free port.
    """

    def __init__(self, image: Callable[[int], Image], fps: float = 30.0, port: int = 0) -> None:
        self._image, self._fps, self._port = image, fps, port
        self.frozen = self.gone = False
        self.sent = 0
        self._stopped = threading.Event()

    @property
    def url(self) -> str:
        """Address of the camera."""
        return f"http://127.0.0.1:{self._port}/camera.mjpg"

    def __enter__(self) -> Self:
        """Starts the HTTP server in a thread of its own; each connection gets a stream of images."""
        emulator = self

        class Stream(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                if emulator.gone:
                    self.send_error(503)
                    return
                self.send_response(200)
                self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={_BOUNDARY}")
                self.end_headers()
                emulator.stream(self.wfile.write)

            def log_message(self, format: str, *args: object) -> None:
                del format, args

        self._server = ThreadingHTTPServer(("127.0.0.1", self._port), Stream)
        self._server.daemon_threads = True
        self._port = self._server.server_address[1]
        self._thread = threading.Thread(
            target=self._server.serve_forever, kwargs={"poll_interval": _POLL_S}, daemon=True
        )
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()

    def stream(self, write: Callable[[bytes], object]) -> None:
        """Sends images until the connection ends."""
        due = time.monotonic()
        while not self._stopped.is_set() and not self.gone:
            due += 1.0 / self._fps
            self._stopped.wait(max(0.0, due - time.monotonic()))
            if self.frozen:
                continue
            _, data = encode_image(self._image(self.sent), lossless=False, jpeg_quality=90)
            head = f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
            try:
                write(head.encode() + data + b"\r\n")
            except OSError:  # the connection has ended
                return
            self.sent += 1
