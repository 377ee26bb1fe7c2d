"""Sets of single images: the sessions from which they come, and the frames that are taken from each."""

from typing import Annotated

import numpy as np
from pydantic import Field

from ..errors import InputError
from ..types import IntArray
from ._bench import SimulatedBench
from ._fields import Settings, Share
from ._imaging import view_names
from ._settings import AnySimulationSettings
from .world import APPROACH_S, FAST, require_long_enough

_FIRST_SESSION = 100_000
"""Number of the first session for single images. Recordings are sessions 0 to 999 of a seed, so none is used twice."""
_CLOCK_OFFSET_SD_MS = 0.5
"""Standard deviation of a clock offset that is determined in a minute of recording."""


class SampleSet(Settings):
    """``samples`` images of sessions with ``settings``, ``per_session`` of each."""

    settings: AnySimulationSettings
    seed: Annotated[int, Field(ge=0, lt=1 << 63)]
    samples: Annotated[int, Field(ge=1, le=100_000_000)]
    per_session: Annotated[int, Field(ge=1, le=1_000_000)]
    before_share: Share
    """Share of the images from the time before the tip is brought to the wall."""

    @property
    def sessions(self) -> int:
        """Number of sessions."""
        return -(-self.samples // self.per_session)

    @property
    def views(self) -> tuple[str, ...]:
        """Names of the views of each sample."""
        return view_names(self.settings)

    def bench(self, number: int) -> SimulatedBench:
        """Returns the ``number``-th session, from 0; its name contains preset, seed and number."""
        name = f"{self.settings.preset.replace(' ', '-')}-{self.seed}-{number:05d}"
        return SimulatedBench(self.settings, self.seed, _FIRST_SESSION + number, resolution=FAST, name=name)

    def frames(self, bench: SimulatedBench, number: int) -> IntArray:
        """Returns the indices (k,) of the frames that are taken of the session, sorted.

        They are drawn at random; the share of frames before contact is ``before_share``.

        Args:
            bench: the session.
            number: its number in this set, from 0.

        Returns:
            (k,) indices of frames.
        """
        rng = self._rng(number, 6)
        count = min(self.per_session, self.samples - number * self.per_session)
        world = self.settings.world
        before_contact = bench.frame_s < world.tare_s + APPROACH_S
        # The force log covers the frame, with a margin of 10 ms at both ends, and no view has dropped it.
        usable = (bench.frame_s > bench.log.true_s[0] + 0.01) & (bench.frame_s < bench.log.true_s[-1] - 0.01)
        for view in bench.views:
            usable &= np.isin(np.arange(len(usable)), bench.arrived(view))
        early, late = np.flatnonzero(before_contact & usable), np.flatnonzero(~before_contact & usable)
        # The number of early frames, limited so that there are enough frames of both kinds.
        early_count = int(np.clip(rng.binomial(count, self.before_share), count - len(late), len(early)))
        chosen = [rng.choice(early, early_count, replace=False), rng.choice(late, count - early_count, replace=False)]
        return np.sort(np.concatenate(chosen))

    def offset_ms(self, bench: SimulatedBench, number: int) -> float:
        """Returns the clock offset of the force log at the middle of a session, with the error of a measurement.

        Args:
            bench: the session.
            number: its number in this set, from 0.

        Returns:
            True time minus stamp, in milliseconds.
        """
        log = bench.log
        middle = len(log.true_s) // 2
        true_ms = 1e3 * float(log.true_s[middle] - 1e-9 * log.stamp_ns[middle])
        return true_ms + float(self._rng(number, 7).normal(0.0, _CLOCK_OFFSET_SD_MS))

    def _rng(self, number: int, purpose: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, _FIRST_SESSION + number, purpose])


def sample_set(
    settings: AnySimulationSettings, *, seed: int, samples: int, per_session: int, seconds: float | None = None
) -> SampleSet:
    """Makes a set of single images of the bench of ``settings``.

    Its share of images before the contact is that of sessions of full length.

    Args:
        settings: settings of the bench, for instance of a preset.
        seed: seed of all random numbers.
        samples: number of images.
        per_session: number of images that are taken of each session.
        seconds: length of each session. None: tare, approach and two breaths, or the length in ``settings`` if that is
            shorter or the knob moves.

    Returns:
        The set.

    Raises:
        InputError: a session is too short, or has too few frames.
    """
    world = settings.world
    before = (world.tare_s + APPROACH_S) / world.seconds
    if seconds is None:
        two_breaths_s = world.tare_s + APPROACH_S + 2.0 / world.motion.respiration_hz
        seconds = min(world.seconds, two_breaths_s) if world.actuation.knob_deg_per_s == 0.0 else world.seconds
    world = world.model_copy(update={"seconds": seconds})
    require_long_enough(world)
    most_frames = int(0.8 * seconds * world.clock.fps)  # some frames are dropped or outside of the force log
    if per_session > most_frames:
        raise InputError(
            f"samples_per_session={per_session}: a session of {seconds:g} s has images enough for {most_frames}; state "
            "seconds for a longer one"
        )
    run = settings.model_copy(update={"world": world, "preset": f"{settings.preset} samples"})
    return SampleSet(settings=run, seed=seed, samples=samples, per_session=per_session, before_share=min(before, 1.0))
