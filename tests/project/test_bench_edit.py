"""Values written into a ``bench.toml``: what a person wrote there stays."""

import tomllib

import pytest

from tipforce.errors import InputError
from tipforce.types import SessionInfo, bench_text, edited_bench

WRITTEN = """# my bench, do not touch
[catheter]   # the blue one
name = "7F"
diameter_m = 2e-3  # by calliper
stiffness_profile = [
    [0.0, 1.0],  # base
    [1.0, 0.5],
]

# the camera above
[views.camera]
metres_per_px = 2e-4

# sensor
[sensor]
reads = "tip-on-tissue"
"""


def test_values_replace_and_join_what_is_there_and_all_comments_stay() -> None:
    values = {
        "catheter.diameter_m": (2.33e-3, "+- 1 %"),
        "catheter.stiffness_profile": ([[0.0, 1.1], [1.0, 1.0]], ""),
        "catheter.rigid_length_m": (8e-3, "new"),
        "sensor.angle_deg": (41.5, "found"),
        "tissue.stiffness_n_per_m": (118.0, "soft"),
    }
    made = edited_bench(WRITTEN, values)
    found = tomllib.loads(made)
    assert found["catheter"] == {
        "name": "7F", "diameter_m": 2.33e-3, "stiffness_profile": [[0.0, 1.1], [1.0, 1.0]], "rigid_length_m": 8e-3,
    }  # fmt: skip
    assert found["views"] == {"camera": {"metres_per_px": 2e-4}}
    assert found["sensor"] == {"reads": "tip-on-tissue", "angle_deg": 41.5}
    assert found["tissue"] == {"stiffness_n_per_m": 118.0}
    for kept in ("# my bench, do not touch", "# the blue one", "# by calliper", "# base", "# the camera above"):
        assert kept in made
    assert "# before: diameter_m = 2e-3" in made
    assert made.index("rigid_length_m") < made.index("# the camera above")


def test_a_file_with_every_value_as_a_comment_gets_it_in_its_place() -> None:
    made = edited_bench(bench_text(SessionInfo()), {"sensor.moving_mass_kg": (0.051, "found")})
    assert "moving_mass_kg = 0.051  # found" in made.splitlines()
    assert "#moving_mass_kg" not in made
    assert SessionInfo.from_values(tomllib.loads(made)).sensor.moving_mass_kg == 0.051


def test_an_empty_file_gets_a_section() -> None:
    assert edited_bench("", {"tissue.stiffness_n_per_m": (120.0, "")}) == "[tissue]\nstiffness_n_per_m = 120.0\n"


@pytest.mark.parametrize("text", ["catheter = { diameter_m = 2e-3 }", "catheter.diameter_m = 2e-3"])
def test_a_form_that_is_not_edited_is_refused_and_named(text: str) -> None:
    with pytest.raises(InputError, match=r"catheter\.diameter_m cannot be written into it line by line"):
        edited_bench(text, {"catheter.diameter_m": (2.33e-3, "")})


def test_what_is_no_toml_is_called_so() -> None:
    with pytest.raises(InputError, match=r"mine\.toml: is no TOML"):
        edited_bench("[catheter", {"catheter.diameter_m": (2.33e-3, "")}, "mine.toml")
