"""The environment variable that says how many cores to use."""

import pytest

from tipforce._system.cores import CORES, cores
from tipforce.errors import InputError


def test_as_many_cores_as_stated_are_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(CORES, raising=False)
    assert cores() >= 1
    monkeypatch.setenv(CORES, "3")
    assert cores() == 3


@pytest.mark.parametrize("stated", ["0", "-1", "two", "", "1e3", "99999"])
def test_other_words_are_refused(stated: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CORES, stated)
    with pytest.raises(InputError, match="TIPFORCE_CORES="):
        cores()
