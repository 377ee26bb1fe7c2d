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


def test_a_setting_of_fusion_within_another_keeps_the_others() -> None:
    changed = settings_from(FusionSettings, ["prior.stiffness=0.02", "contact.law_error=0.3"])
    assert changed.prior == RodTrackSettings().prior.model_copy(update={"stiffness": 0.02})
    assert changed.contact == FusionSettings().contact.model_copy(update={"law_error": 0.3})
