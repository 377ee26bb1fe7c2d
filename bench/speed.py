"""``python -m bench.speed``: frame in memory -> force, compared with one read of the frame and with the textbook chain.

One process, one thread. Frames come from a pool that is larger than the caches, as a camera's frame would: the
timed work starts in main memory.
The three are timed in turn, block by block, so that other load of the machine affects all three; ratios are those of
the quickest block of each.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numba
import numpy as np
from bench.parts import run_alone
from bench.tubes import Look, Tube, distance_to_curve, draw, shape
from sklearn.svm import SVR
from threadpoolctl import threadpool_limits

from tipforce.datasets import Dataset
from tipforce.estimators import Estimator, create
from tipforce.types import ForceEstimate, Observation, SessionInfo, ShapeFeatures
from tipforce.vision import ShapeDetector, VisionSettings, auto_calibrate, feature_names, shape_features

POOL_BYTES = 96 * 2**20
"""Size of the pool of frames; the last-level caches of today's processors hold less."""
SHAPES = 24
BLOCKS = 8
"""Number of blocks of each way."""
SIZES = ((640, 480), (1280, 1024))
LOOKS = {
    "clean": Look(noise=0.0, blur=0.7, rings=0, gradient=0.0, turning=1.2),
    "noisy": Look(rings=0, gradient=0.0, turning=1.2),
    "rings and gradient": Look(turning=1.2),
}
"""Kinds of frames; from the second on with noise of 5 grey levels and a blur of 1 px."""


@numba.njit
def read_once(words: Any) -> int:
    """The sum of a frame's 64-bit words, in four streams: touches every byte once and does nothing else."""
    quarter = words.size // 4
    a, b, c, d = np.uint64(0), np.uint64(0), np.uint64(0), np.uint64(0)
    for i in range(quarter):
        a += words[i]
        b += words[i + quarter]
        c += words[i + 2 * quarter]
        d += words[i + 3 * quarter]
    return a + b + c + d


@dataclass(frozen=True)
class Case:
    """One kind of frame: a pool in memory, and the computation from image to force in each way."""

    name: str
    size: tuple[int, int]
    drawn: list[Tube]
    pool: list[np.ndarray]
    words: list[np.ndarray]

    @property
    def bytes(self) -> int:
        return self.pool[0].nbytes


def make_case(name: str, size: tuple[int, int], seed: int = 0) -> Case:
    """A pool of drawn tubes, larger than the caches."""
    rng = np.random.default_rng(seed)
    scale = size[0] / 640
    look = replace(LOOKS[name], size=size, length=(200.0 * scale, 340.0 * scale), diameter=12.0 * scale)
    drawn: list[Tube] = [draw(rng, look) for _ in range(SHAPES)]
    count = max(SHAPES, POOL_BYTES // drawn[0].image.nbytes)
    pool = [drawn[k % SHAPES].image.copy() for k in range(count)]
    return Case(name, size, drawn, pool, [frame.reshape(-1).view(np.uint64) for frame in pool])


class Rows:
    """Samples that are ready-made shape coefficients."""

    def __init__(self, names: tuple[str, ...], values: np.ndarray, knob_deg: np.ndarray) -> None:
        self.names, self.values, self.knob_deg = names, values, knob_deg

    def read(self, rows: np.ndarray) -> Iterator[Observation]:
        for row in rows.tolist():
            view = ShapeFeatures(self.names, self.values[row])
            yield Observation(row, {"camera": view}, {"knob_deg": float(self.knob_deg[row])})


def training_set(size: tuple[int, int], samples: int = 220, seed: int = 1) -> Dataset:
    """220 random shapes with a force that a spring at the tip would feel: enough to size a model as the thesis's."""
    rng = np.random.default_rng(seed)
    settings = create("svr").settings.features  # type: ignore[attr-defined]
    scale = size[0] / 640
    values, forces = [], []
    while len(values) < samples:
        curve = shape(rng, scale * rng.uniform(200, 340), 1.2)[::20]
        x, y = curve.T
        if np.any(np.diff(x) <= 0):
            continue
        values.append(np.polyfit(x, y, 4))
        forces.append(0.15 + 0.1 * np.tanh(y[-1] / (100 * scale)) + rng.normal(0, 0.004))
    store = Rows(feature_names(settings), np.array(values), np.full(samples, 10.0))
    force = np.full((samples, 3), np.nan)
    force[:, 0], force[:, 1] = 0.0, forces
    sessions = np.array([f"s{k * 4 // samples}" for k in range(samples)])
    return Dataset(
        store=store,
        session=sessions,
        stamp_ns=np.arange(samples) * 40_000_000,
        actuation={"knob_deg": store.knob_deg},
        force_n=force,
        known=np.array([True, True, False]),
        names=np.arange(samples).astype(str),
        session_info={name: SessionInfo(name=name) for name in np.unique(sessions).tolist()},
        rows=np.arange(samples),
    )


class Textbook:
    """The chain that a careful reader would write from the thesis with the usual libraries."""

    def __init__(self, size: tuple[int, int]) -> None:
        data = training_set(size)
        self.top = np.abs(data.store.values).max(axis=0)  # type: ignore[attr-defined]
        rows = np.column_stack([data.store.values / self.top, np.ones(len(data))])  # type: ignore[attr-defined]
        self.force_top = float(data.magnitude_n.max())
        self.model = SVR(kernel="rbf", C=10.0, epsilon=0.01, gamma=1.0).fit(rows, data.magnitude_n / self.force_top)

    def shape(self, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Skeleton pixels of the largest dark piece, ordered by column."""
        from skimage.morphology import skeletonize

        grey = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
        binary = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY_INV + cv2.THRESH_OTSU)[1]
        _, marks, stats, _ = cv2.connectedComponentsWithStats(binary)
        largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
        v, u = np.nonzero(skeletonize(marks == largest))
        order = np.argsort(u, kind="stable")
        return u[order].astype(float), v[order].astype(float)

    def force(self, frame: np.ndarray) -> float:
        u, v = self.shape(frame)
        base = u < u[0] + 20
        if len(np.unique(u)) < 5 or len(np.unique(u[base])) < 2:
            return float("nan")  # the largest piece that is left of the shaft is upright
        slope = np.polyfit(u[base], v[base], 1)[0]
        cos, sin = 1 / np.hypot(1, slope), slope / np.hypot(1, slope)
        du, dv = u - u[0], v - v[0]
        coefficients = np.polyfit(cos * du + sin * dv, sin * du - cos * dv, 4)
        row = np.append(coefficients / self.top, 1.0)
        return float(self.model.predict(row[None])[0]) * self.force_top


def lost(points: np.ndarray, tube: Tube) -> bool:
    """Whether the points miss the tip by three diameters, or one in ten is outside the tube."""
    off = distance_to_curve(points[:: max(1, len(points) // 200)], tube.curve)
    tip = np.hypot(*(points - tube.curve[-1]).T).min()
    return bool(np.percentile(off, 90) > 0.5 * tube.look.diameter or tip > 3 * tube.look.diameter)


def trained(case: Case) -> Estimator:
    """The thesis's method with the tracer in front of it, its settings found on the first frames."""
    found = auto_calibrate(VisionSettings(method="tracer"), [tube.image for tube in case.drawn])
    vision = VisionSettings(
        polarity=found.polarity, base_side=found.base_side, threshold=found.threshold, diameter_px=found.diameter_px
    )
    return create("svr", {"vision": vision}).fit(training_set(case.size))


def timed(work: Callable[[int], Any], count: int, start: int) -> np.ndarray:
    """(count,) microseconds of ``work(start)``, ``work(start + 1)``, ..."""
    times = np.empty(count)
    clock = time.perf_counter_ns
    for k in range(count):
        before = clock()
        work(start + k)
        times[k] = clock() - before
    return times * 1e-3


def measure_case(case: Case, blocks: int) -> dict[str, Any]:
    """Returns microseconds, p50 and p99: reading, detection, the chain to the force, and the textbook chain."""
    pool, words, n = case.pool, case.words, len(case.pool)
    estimator = trained(case)
    stream = estimator.start(SessionInfo())
    textbook = Textbook(case.size)
    vision: VisionSettings = estimator.settings.vision  # type: ignore[attr-defined]
    features = estimator.settings.features  # type: ignore[attr-defined]
    eye = ShapeDetector(vision)
    knob = {"knob_deg": 10.0}
    answers: list[ForceEstimate] = []

    def whole(k: int) -> None:
        answers.append(stream.update(Observation(k, {"camera": pool[k % n]}, knob)))

    def see(k: int) -> None:
        eye.detect(pool[k % n])

    lost_fine = [not (s := eye.detect(t.image)).found or lost(s.centreline.points, t) for t in case.drawn]  # type: ignore[union-attr]
    lost_book = [lost(np.column_stack(textbook.shape(t.image)), t) for t in case.drawn]
    fitted = [s for s in (eye.detect(frame) for frame in pool[:SHAPES]) if s.found]
    ways: dict[str, tuple[Callable[[int], Any], int]] = {
        "read once, from memory": (lambda k: read_once(words[k % n]), n),
        "read once, hot in cache": (lambda _: read_once(words[0]), n),
        "frame -> centreline": (see, 2 * n),
        "centreline -> features": (lambda k: shape_features(fitted[k % len(fitted)], features), 2 * n),
        "frame -> force": (whole, 2 * n),
        "textbook chain": (lambda k: textbook.force(pool[k % n]), max(12, n // 8) if np.mean(lost_book) < 0.5 else 2),
    }
    for work, _ in ways.values():
        timed(work, 8, 0)
    answers.clear()
    times: dict[str, list[np.ndarray]] = {name: [] for name in ways}
    for block in range(blocks):
        for name, (work, count) in ways.items():
            # Starting half a pool further on each time: nothing that was just touched is touched again.
            times[name].append(timed(work, count, (block * n) // 2))
    rows = {
        name: {
            "p50_us": float(np.percentile(np.concatenate(t), 50)),
            "p99_us": float(np.percentile(np.concatenate(t), 99)),
            "best_block_p50_us": float(min(np.percentile(part, 50) for part in t)),
            "frames": int(sum(map(len, t))),
        }
        for name, t in times.items()
    }
    force, read, book = (
        rows[k]["best_block_p50_us"] for k in ("frame -> force", "read once, from memory", "textbook chain")
    )
    return {
        "frames": case.name,
        "size": case.size,
        "pool_mib": round(n * case.bytes / 2**20),
        "times": rows,
        "force_over_read": force / read,
        "textbook_over_force": book / force if np.mean(lost_book) < 0.5 else None,
        "valid": sum(a.valid for a in answers) / max(1, len(answers)),
        "lost": float(np.mean(lost_fine)),
        "textbook_lost": float(np.mean(lost_book)),
    }


def measure() -> list[dict[str, Any]]:
    """Returns the figures of each kind of frame at each size."""
    cv2.setNumThreads(1)
    with threadpool_limits(1):
        return [measure_case(make_case(name, size), BLOCKS) for size in SIZES for name in LOOKS]


def show(figures: list[dict[str, Any]]) -> None:
    for result in figures:
        width, height = result["size"]
        print(f"frame -> force, {result['frames']}, {width}x{height} RGB, pool of {result['pool_mib']} MiB")
        for name, row in result["times"].items():
            print(
                f"  {name:26} p50 {row['p50_us']:9.1f} us, p99 {row['p99_us']:9.1f} us, best block's p50 "
                f"{row['best_block_p50_us']:9.1f} us"
            )
        ratio = result["textbook_over_force"]
        book = "the textbook chain does not see this shape" if ratio is None else f"the textbook chain {ratio:.0f} x"
        print(
            f"  {result['force_over_read']:.2f} x reading once; {book}; force on {result['valid']:.0%} of the frames, "
            f"shape lost in {result['lost']:.0%}, by the textbook chain in {result['textbook_lost']:.0%}"
        )


if __name__ == "__main__":
    run_alone("force", measure, show, __doc__)
