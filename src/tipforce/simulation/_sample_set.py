"""Sets of single images: which sessions they come from, and which of their frames are taken."""

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

_FIRST = 100_000
"""Recordings are sessions 0 to 999 of a seed: what single images are taken from is never one of them."""
_OFFSET_MS = 0.5
"""Standard deviation of a clock offset as it is found in a minute of recording."""


class SampleSet(Settings):
    """``samples`` images of sessions with ``settings``, ``per_session`` of each."""

    settings: AnySimulationSettings
    seed: Annotated[int, Field(ge=0, lt=1 << 63)]
    samples: Annotated[int, Field(ge=1, le=100_000_000)]
    per_session: Annotated[int, Field(ge=1, le=1_000_000)]
    before_share: Share
    """Of the images: before the tip is brought to the wall."""

    @property
    def sessions(self) -> int:
        """How many are needed."""
        return -(-self.samples // self.per_session)

    @property
    def views(self) -> tuple[str, ...]:
        """Of each sample."""
        return view_names(self.settings)

    def bench(self, number: int) -> SimulatedBench:
        """The ``number``-th session, from 0; the name tells preset, seed and number."""
        name = f"{self.settings.preset.replace(' ', '-')}-{self.seed}-{number:05d}"
        return SimulatedBench(self.settings, self.seed, _FIRST + number, resolution=FAST, name=name)

    def frames(self, bench: SimulatedBench, number: int) -> IntArray:
        """(k,) frames that are taken of the session, sorted: at random, so many of them before contact as stated."""
        rng = self._rng(number, 6)
        count = min(self.per_session, self.samples - number * self.per_session)
        world = self.settings.world
        before = bench.frame_s < world.tare_s + APPROACH_S
        logged = (bench.frame_s > bench.log.true_s[0] + 0.01) & (bench.frame_s < bench.log.true_s[-1] - 0.01)
        for view in bench.views:
            logged &= np.isin(np.arange(len(logged)), bench.arrived(view))
        early, late = np.flatnonzero(before & logged), np.flatnonzero(~before & logged)
        some = int(np.clip(rng.binomial(count, self.before_share), count - len(late), len(early)))
        chosen = [rng.choice(early, some, replace=False), rng.choice(late, count - some, replace=False)]
        return np.sort(np.concatenate(chosen))

    def offset_ms(self, bench: SimulatedBench, number: int) -> float:
        """The force log's clock offset as a person at the bench knows it, at the middle of the session."""
        log = bench.log
        middle = len(log.true_s) // 2
        true_ms = 1e3 * float(log.true_s[middle] - 1e-9 * log.stamp_ns[middle])
        return true_ms + float(self._rng(number, 7).normal(0.0, _OFFSET_MS))

    def _rng(self, number: int, purpose: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, _FIRST + number, purpose])


def sample_set(
    settings: AnySimulationSettings, *, seed: int, samples: int, per_session: int, seconds: float | None = None
) -> SampleSet:
    """A set of single images of a preset's (or other) bench, from sessions of ``seconds``.

    None: as long as the stretch in which the preset's own motion is solved, two breaths, where the knob stands still;
    the preset's length where it moves. As many images are from before the contact as in sessions of full length.
    Raises InputError where a session is too short, or has too few frames.
    """
    world = settings.world
    before = (world.tare_s + APPROACH_S) / world.seconds
    if seconds is None:
        short = world.tare_s + APPROACH_S + 2.0 / world.motion.respiration_hz
        seconds = min(world.seconds, short) if world.actuation.knob_deg_per_s == 0.0 else world.seconds
    world = world.model_copy(update={"seconds": seconds})
    require_long_enough(world)
    most = int(0.8 * seconds * world.clock.fps)
    if per_session > most:
        raise InputError(
            f"samples_per_session={per_session}: a session of {seconds:g} s has images enough for {most}; state "
            "seconds for a longer one"
        )
    run = settings.model_copy(update={"world": world, "preset": f"{settings.preset} samples"})
    return SampleSet(settings=run, seed=seed, samples=samples, per_session=per_session, before_share=min(before, 1.0))
