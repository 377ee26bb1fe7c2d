"""Where the catheter goes on beyond what the first look follows, and where it does not."""

from dataclasses import replace

import numpy as np
import pytest

from tipforce.types import Status
from tipforce.vision import Tracer, VisionSettings

from .conftest import judge, load  # type: ignore[import-not-found]

tubes = load("tubes")
KNOWN = VisionSettings(polarity="dark", base_side="left", diameter_px=12.0)
BENCH = tubes.Look(
    electrode=150.0, highlight=50.0, shadow=0.25, texture=5.0, vignette=0.25, exposure=2.0, tissue=120.0, noise=4.0
)


def test_a_pale_electrode_with_one_flank_in_shadow_is_followed_to_its_tip() -> None:
    tips = []
    for seed in range(100, 112):
        tube = tubes.draw(np.random.default_rng(seed), BENCH)
        sight = Tracer(KNOWN).detect(tube.image)
        assert sight.centreline is not None
        tips.append(abs(tubes.tip_along(sight.centreline.points, tube)))
    assert np.sum(np.array(tips) < 3) >= 11
    assert np.median(tips) < 0.6


@pytest.mark.parametrize("texture", [pytest.param(12.0, marks=pytest.mark.slow), 16.0])
def test_texture_behind_the_tip_is_not_taken_for_an_electrode(texture: float) -> None:
    assert judge(tubes.Look(texture=texture), range(200, 206), KNOWN) == (6, 0)


@pytest.mark.parametrize("grey", [60.0, pytest.param(240.0, marks=pytest.mark.slow)])
def test_a_cable_as_thick_as_the_catheter_is_crossed_or_the_frame_refused(grey: float) -> None:
    right, wrong = judge(tubes.Look(cable=12.0, cable_grey=grey), range(300, 308), KNOWN)
    assert right >= 6
    assert wrong == 0


def test_a_thin_shaft_is_followed_behind_its_rings() -> None:
    look = replace(tubes.Look(), diameter=4.0)
    assert judge(look, range(400, 406), KNOWN.model_copy(update={"diameter_px": 4.2})) == (6, 0)


def test_a_gap_is_not_taken_for_the_tip() -> None:
    """Behind a bare gap longer than allowed a shaft of full contrast is the same shaft, a pale one is not."""
    assert judge(tubes.Look(gap=24.0, rings=0), range(500, 504), KNOWN) == (0, 0)


def test_an_image_too_blurred_to_tell_is_mostly_refused() -> None:
    """Blurred by half its width the shaft has no flanks left; what is answered then is hardly ever right."""
    refused = 0
    for seed in range(600, 612):
        tube = tubes.draw(np.random.default_rng(seed), tubes.Look(blur=6.0))
        sight = Tracer(KNOWN).detect(tube.image)
        refused += not sight.found
        if sight.status is Status.NO_CATHETER and "scatter" in sight.detail:
            assert sight.centreline is None
    assert refused >= 7
