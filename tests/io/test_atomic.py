"""A folder is replaced whole, and the old one stays where the new one fails."""

from pathlib import Path

import pytest

from tipforce.io import replacing_folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder that stands already."""
    (tmp_path / "deep" / "made").mkdir(parents=True)
    (tmp_path / "deep" / "made" / "old.txt").write_text("old")
    return tmp_path / "deep" / "made"


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_the_new_folder_has_only_what_is_new_and_can_be_read_by_others(folder: Path) -> None:
    with replacing_folder(folder) as part:
        (part / "new.txt").write_text("new")
        assert names(folder) == ["old.txt"]
    assert names(folder) == ["new.txt"]
    assert names(folder.parent) == ["made"]
    assert folder.stat().st_mode & 0o777 == 0o755


def test_folders_above_it_are_made(tmp_path: Path) -> None:
    with replacing_folder(tmp_path / "a" / "b") as part:
        (part / "new.txt").write_text("new")
    assert names(tmp_path / "a" / "b") == ["new.txt"]


def test_an_error_while_it_is_filled_keeps_the_old_one(folder: Path) -> None:
    with pytest.raises(FileNotFoundError), replacing_folder(folder) as part:
        (part / "deeper" / "new.txt").write_text("new")
    assert names(folder) == ["old.txt"]
    assert names(folder.parent) == ["made"]


def test_the_old_one_comes_back_where_the_new_one_cannot_take_its_place(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = Path.replace

    def busy(self: Path, target: Path) -> Path:
        if self.suffix == ".part":
            raise OSError("device busy")
        return real(self, target)

    monkeypatch.setattr(Path, "replace", busy)
    with pytest.raises(OSError, match="device busy"), replacing_folder(folder) as part:
        (part / "new.txt").write_text("new")
    assert names(folder) == ["old.txt"]
    assert names(folder.parent) == ["made"]
