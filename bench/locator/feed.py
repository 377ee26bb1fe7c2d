"""Workers that draw training windows, and the shared memory that receives these."""

from collections.abc import Iterator
from multiprocessing import get_context, shared_memory
from pathlib import Path
from queue import Empty
from typing import Any

import cv2
import numpy as np
from bench.locator import scene
from bench.locator.presets import PRESET_IMAGE_SHARES, PRESET_IMAGES_SEED, preset_images
from bench.locator.tubes import Drawer

from tipforce.training.locator import WINDOW_FIELDS, WINDOW_PX, LabelledImage, random_scene, window, window_shapes

CHUNK = 16
"""Number of windows that a worker passes at a time."""
SLOTS = 96
PRESET_SHARE = 0.42
"""Share of the workers that draw windows from the presets' renderers; they are slower."""
XRAY_PRESETS = ("fluoro", "biplane")
"""The names of X-ray presets begin with these."""
_FIRST_IMAGES, _RESERVOIR_IMAGES, _WINDOWS_PER_IMAGE = 24, 240, 6

Array = np.ndarray[Any, Any]


def _layout() -> tuple[dict[str, tuple[int, tuple[int, ...], Any]], int]:
    """Offset, shape and type of each field in a slot, and the bytes of a slot."""
    places, at = {}, 0
    for name, (shape, kind) in window_shapes().items():
        full = (CHUNK, *shape)
        places[name] = (at, full, kind)
        at += int(np.prod(full)) * np.dtype(kind).itemsize
        at += -at % 64
    return places, at


def _views(memory: shared_memory.SharedMemory, slot: int) -> dict[str, Array]:
    places, size = _layout()
    return {
        name: np.ndarray(shape, kind, memory.buf, offset=slot * size + at) for name, (at, shape, kind) in places.items()
    }


def image_shares(xray_share: float | None = None) -> dict[str, float]:
    """Returns the share of each preset's images; those of the X-ray presets together are ``xray_share`` if given."""
    shares = PRESET_IMAGE_SHARES
    if xray_share is None:
        return shares
    xray = sum(share for name, share in shares.items() if name.startswith(XRAY_PRESETS))
    camera = sum(shares.values()) - xray
    return {
        name: share * (xray_share / xray if name.startswith(XRAY_PRESETS) else (1.0 - xray_share) / camera)
        for name, share in shares.items()
    }


def _work(
    kind: str, seed: int, memory: shared_memory.SharedMemory, free: Any, full: Any, shares: dict[str, float],
    scene_xray_share: float,
) -> None:  # fmt: skip
    """One worker: draws windows into free slots of the shared memory until it is ended."""
    cv2.setNumThreads(1)
    rng = np.random.default_rng([seed, 77])
    windows = preset_windows(rng, seed, shares) if kind == "presets" else scene_windows(rng, scene_xray_share)
    while True:
        slot = free.get()
        views = _views(memory, slot)
        for k in range(CHUNK):
            drawn = next(windows)
            for name in WINDOW_FIELDS:
                views[name][k] = getattr(drawn, name)
        full.put(slot)


def scene_windows(rng: np.random.Generator, xray_share: float = scene.XRAY_SHARE) -> Iterator[Any]:
    """Yields windows of the compositor's scenes, of which ``xray_share`` are X-ray images."""
    drawer = Drawer(WINDOW_PX, WINDOW_PX)
    while True:
        yield window(scene.draw(rng, drawer, WINDOW_PX, xray_share=xray_share), rng, 0)


def preset_windows(
    rng: np.random.Generator, seed: int, shares: dict[str, float] = PRESET_IMAGE_SHARES
) -> Iterator[Any]:
    """Yields windows of stored images; one image is replaced after every few windows."""
    kept: list[LabelledImage] = []
    for sample in labelled_images(rng, seed, shares):
        kept.append(sample)
        if len(kept) > _RESERVOIR_IMAGES:
            kept.pop(int(rng.integers(_RESERVOIR_IMAGES)))
        for _ in range(_WINDOWS_PER_IMAGE if len(kept) > _FIRST_IMAGES else 2):
            chosen = kept[int(rng.integers(len(kept)))]
            yield window(random_scene(chosen, rng), rng, 2 if chosen.xray else 1)


def labelled_images(
    rng: np.random.Generator, seed: int, shares: dict[str, float] = PRESET_IMAGE_SHARES
) -> Iterator[LabelledImage]:
    """Yields images of sessions of the presets, each preset in its share."""
    names, weights = list(shares), np.array(list(shares.values()))
    number = 0
    while True:
        number += 1
        preset = str(rng.choice(names, p=weights / weights.sum()))
        yield from preset_images(PRESET_IMAGES_SEED + seed, number, preset)


class Feed:
    """Worker processes, and the shared memory that receives their windows.

    The workers are forked: a feed has to be made before the process uses a GPU.

    Args:
        workers: number of processes.
        seed: of the first worker; the others follow.
        preset_share: share of the workers that draw from the presets' renderers.
        xray_share: share of X-ray among the images of the presets; None: that of ``PRESET_IMAGE_SHARES``.
        scene_xray_share: share of X-ray among the scenes.
    """

    def __init__(
        self, workers: int, seed: int, preset_share: float = PRESET_SHARE, xray_share: float | None = None,
        scene_xray_share: float = scene.XRAY_SHARE,
    ) -> None:  # fmt: skip
        context = get_context("fork")
        self._memory = shared_memory.SharedMemory(create=True, size=SLOTS * _layout()[1])
        self._free, self._full = context.Queue(), context.Queue()
        for slot in range(SLOTS):
            self._free.put(slot)
        drawing = round(preset_share * workers)
        given = self._memory, self._free, self._full, image_shares(xray_share), scene_xray_share
        self._processes = [
            context.Process(
                target=_work,
                args=("presets" if k < drawing else "scenes", seed + k, *given),
                daemon=True,
            )
            for k in range(workers)
        ]
        for process in self._processes:
            process.start()

    def chunks(self, count: int) -> dict[str, Array]:
        """The next ``count`` * CHUNK windows; waits for them."""
        parts: list[dict[str, Array]] = []
        while len(parts) < count:
            try:
                slot = self._full.get(timeout=120.0)
            except Empty:
                if not any(process.is_alive() for process in self._processes):
                    raise SystemExit("all workers have ended; look at their messages above") from None
                continue
            parts.append({name: view.copy() for name, view in _views(self._memory, slot).items()})
            self._free.put(slot)
        return {name: np.concatenate([part[name] for part in parts]) for name in WINDOW_FIELDS}

    def close(self) -> None:
        """Ends the workers."""
        for process in self._processes:
            process.kill()
        self._memory.close()
        self._memory.unlink()


CHECKS_SEED = 900_000
"""First seed of the windows that evaluate a training; training seeds are smaller."""


def write_checks(path: Path, count: int, workers: int) -> None:
    """Writes ``count`` windows held out from training, half of them of presets, to ``path`` (.npz)."""
    halves = []
    for share in (0.0, 1.0):
        feed = Feed(workers, CHECKS_SEED + int(100 * share), share)
        halves.append(feed.chunks(max(1, count // 2 // CHUNK)))
        feed.close()
    partial = path.with_suffix(".part.npz")
    np.savez(partial, **{name: np.concatenate([half[name] for half in halves]) for name in WINDOW_FIELDS})
    partial.replace(path)


def main() -> None:
    """python -m bench.locator.feed DIR/checks.npz COUNT WORKERS."""
    import sys

    write_checks(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))


if __name__ == "__main__":
    main()
