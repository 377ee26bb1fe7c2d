"""``--set``: one setting inside another leaves its neighbours as they are."""

from pydantic import BaseModel

from tipforce.cli._settings import settings_from
from tipforce.estimators import FusionSettings, PriorSettings, RodTrackSettings


class Narrow(BaseModel):
    """A method whose own default of an inner setting differs from that of the type."""

    prior: PriorSettings = PriorSettings(largest_force_n=0.2)


class Outer(BaseModel):
    rod: Narrow = Narrow()


def test_one_inner_setting_leaves_the_methods_own_defaults_beside_it() -> None:
    for found in (
        settings_from(Narrow, ["prior.stiffness=0.02"]).prior,
        settings_from(Outer, ["rod.prior.stiffness=0.02"]).rod.prior,
    ):
        assert found == PriorSettings(largest_force_n=0.2, stiffness=0.02)


def test_settings_of_a_member_of_fusion_are_set_by_their_path() -> None:
    within = settings_from(FusionSettings, ["rod.prior.stiffness=0.02", "rod.vision.view=a"]).rod
    assert within.prior == RodTrackSettings().prior.model_copy(update={"stiffness": 0.02})
    assert within.vision.view == "a"
