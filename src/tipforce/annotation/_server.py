"""Serves the page on which a person marks the catheter: images, marks and the training, as JSON over HTTP."""

import math
import threading
from collections.abc import Awaitable, Callable
from typing import Any

import cv2
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from .._system.contexts import ClosedAtExit
from .._system.json_files import parse_json
from .._system.web.server import LOCAL_HOST, RunningServer, page_routes, start_server
from ..errors import InputError, TipforceError
from ..io import encode_image
from ..types import FloatArray
from ._session import MIN_WITH_CATHETER, AnnotationSession
from ._training import FineTune, LeftOut, TrainingRun

MAX_BODY_BYTES = 64 << 10
"""Longest request of the page: the points of one line."""
JPEG_QUALITY = 95
THUMBNAIL_WIDTH_PX = 160
FOUND_PROBABILITY = 0.5
"""A catheter that is less probable is shown as not found."""

Answer = Callable[[Request], Awaitable[Response]]


class AnnotationServer(ClosedAtExit):
    """The running page. A context manager: leaving it cancels a training and closes the server.

    Attributes:
        address: address for a browser, with the token if one is required.
        port: port on which the server listens.
        finished: set when the person presses "Finish" on the page.
        training: the training that the page starts.
    """

    def __init__(self, running: RunningServer, finished: threading.Event, training: TrainingRun) -> None:
        self.address, self.port, self.finished, self.training = running.address, running.port, finished, training
        self._running = running

    def close(self) -> None:
        """Cancels the training and ends the server. May be called more than once."""
        self.training.close()
        if self._running.running:
            self._running.close()


def serve_annotation(
    session: AnnotationSession, fine_tune: FineTune, *, title: str, host: str = LOCAL_HOST, port: int = 0
) -> AnnotationServer:
    """Starts the page.

    Args:
        session: the frames and their marks.
        fine_tune: called on a thread of its own when the person presses "Train".
        title: name of the recording or folder.
        host: name or address to listen on; by default only this machine can reach the page.
        port: port to listen on; 0: any free port.

    Returns:
        The running server.

    Raises:
        InputError: the server cannot listen there.
    """
    training, finished = TrainingRun(fine_tune), threading.Event()
    app = _Page(session, training, finished, title)
    running = start_server(app.application, host=host, port=port)
    return AnnotationServer(running, finished, training)


class _Page:
    """The answers to the requests of the page."""

    def __init__(
        self, session: AnnotationSession, training: TrainingRun, finished: threading.Event, title: str
    ) -> None:
        self._session, self._training, self._finished, self._title = session, training, finished, title

    def application(self) -> Starlette:
        """Returns the application with its routes."""
        return Starlette(
            routes=[
                *page_routes("tipforce.annotation"),
                Route("/state", _answer(lambda _: self._state())),
                Route("/images/{index:int}", self._image),
                Route("/thumbnails/{index:int}", self._image),
                Route("/frames/{index:int}", self._mark, methods=["PUT"]),
                Route("/training", _answer(lambda _: self._training_values())),
                Route("/train", _answer(lambda _: self._train()), methods=["POST"]),
                Route("/cancel", _answer(lambda _: self._cancel()), methods=["POST"]),
                Route("/finish", _answer(lambda _: self._finish()), methods=["POST"]),
            ]
        )

    def _state(self) -> dict[str, Any]:
        """Returns all that the page shows but the images: the frames with marks and proposals, and the training."""
        frames = [
            {
                **{key: value for key, value in frame.values().items() if key != "thumbnail"},
                "width": image.shape[1],
                "height": image.shape[0],
                "proposal": {
                    "points_px": _points(proposal.points_px),
                    "carried_from": proposal.carried_from,
                    "detail": proposal.detail,
                },
            }
            for frame, image, proposal in zip(
                self._session.frames, self._session.images, self._session.proposals(), strict=True
            )
        ]
        return {
            "title": self._title,
            "file": self._session.file,
            "min_with_catheter": MIN_WITH_CATHETER,
            "frames": frames,
            "training": self._training_values(),
        }

    async def _image(self, request: Request) -> Response:
        """Answers with the image of a frame as JPEG, or with a small copy for ``/thumbnails``."""
        index = request.path_params["index"]
        if index >= len(self._session):
            return JSONResponse({"error": f"there is no frame {index}"}, 404)
        image = self._session.images[index]
        if request.url.path.startswith("/thumbnails"):
            height = max(1, round(THUMBNAIL_WIDTH_PX * image.shape[0] / image.shape[1]))
            image = cv2.resize(image, (THUMBNAIL_WIDTH_PX, height), interpolation=cv2.INTER_AREA)
        _, data = await run_in_threadpool(encode_image, image, lossless=False, jpeg_quality=JPEG_QUALITY)  # pyright: ignore[reportArgumentType]
        return Response(data, media_type="image/jpeg")

    async def _mark(self, request: Request) -> Response:
        """Replaces the marks of a frame by the JSON values of the request, and answers with the state of the page.

        The body is read in parts, so that a request that is too long is refused before it fills the memory.
        """
        index = request.path_params["index"]
        if index >= len(self._session):
            return JSONResponse({"error": f"there is no frame {index}"}, 404)
        body = bytearray()
        async for part in request.stream():
            body += part
            if len(body) > MAX_BODY_BYTES:
                return JSONResponse({"error": "the request is too long"}, 413)

        def mark() -> dict[str, Any]:
            values = parse_json(bytes(body), "the request")
            if not isinstance(values, dict):
                raise InputError("the request: expected an object")
            self._session.mark(index, values)
            return self._state()

        return await _answer(lambda _: mark())(request)

    def _training_values(self) -> dict[str, Any]:
        """Returns the progress of the training as JSON values, and at its end the lines in frames left out."""
        status = self._training.status
        left_out = [] if status.result is None else [self._left_out(frame) for frame in status.result.left_out]
        return {
            "state": status.state,
            "step": status.step,
            "share": status.share,
            "seconds": round(status.seconds, 1),
            "message": status.message,
            "left_out": [values for values in left_out if values is not None],
        }

    def _left_out(self, frame: LeftOut) -> dict[str, Any] | None:
        """Returns JSON values of a frame that the training left out: its number, and the lines before and after.

        None for a frame that is not on the page. A line of an improbable catheter is empty.
        """
        names = [marked.image for marked in self._session.frames]
        if frame.image not in names:
            return None
        before = _points(frame.before_px) if frame.before_present >= FOUND_PROBABILITY else []
        after = _points(frame.after_px) if frame.after_present >= FOUND_PROBABILITY else []
        return {"index": names.index(frame.image), "before_px": before, "after_px": after}

    def _train(self) -> dict[str, Any]:
        self._training.start(*self._session.annotations())
        return self._training_values()

    def _cancel(self) -> dict[str, Any]:
        self._training.cancel()
        return self._training_values()

    def _finish(self) -> dict[str, Any]:
        self._finished.set()
        return {}


def _answer(made: Callable[[Request], dict[str, Any]]) -> Answer:
    """Returns a route that answers with JSON; an error that the user can correct is the JSON ``error``."""

    async def answer(request: Request) -> Response:
        try:
            return JSONResponse(await run_in_threadpool(made, request))
        except TipforceError as error:
            return JSONResponse({"error": str(error)}, 400)

    return answer


def _points(points_px: FloatArray) -> list[list[float]]:
    """Returns points for JSON; none if one of them is not finite."""
    listed = points_px.round(3).tolist()
    return listed if all(math.isfinite(value) for point in listed for value in point) else []
