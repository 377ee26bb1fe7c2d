"""``--set``: one setting inside another leaves its neighbours as they are."""

from tipforce.cli._settings import settings_from
from tipforce.estimators import FusionSettings, RodTrackSettings


def test_one_inner_setting_leaves_the_methods_own_defaults_beside_it() -> None:
    own = RodTrackSettings().prior
    found = settings_from(RodTrackSettings, ["prior.stiffness=0.02"]).prior
    assert found == own.model_copy(update={"stiffness": 0.02})
    assert found.force_scale_n != type(own)().force_scale_n, "rod-track's own default differs from that of the type"
    within = settings_from(FusionSettings, ["rod.prior.stiffness=0.02", "rod.vision.view=a"]).rod
    assert within.prior == found
    assert within.vision.view == "a"
