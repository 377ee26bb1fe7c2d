"""Files and folders appear whole or not at all; what is there stays where the new one fails; one writer at a time."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tipforce.errors import OutputError
from tipforce.io import atomic_path, replacing_folder, write_atomic


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


def test_a_device_a_pipe_and_a_folder_are_never_replaced(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for path, said in ((tmp_path / "pipe", "no regular file"), (tmp_path / "folder", "is a folder")):
        with pytest.raises(OutputError, match=said):
            write_atomic(path, "text")
    with pytest.raises(OutputError, match="no regular file"):
        write_atomic(Path(os.devnull), "text")
    assert Path(os.devnull).is_char_device()


def test_of_a_link_what_it_points_to_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "real.txt").write_text("old")
    (tmp_path / "link.txt").symlink_to("real.txt")
    write_atomic(tmp_path / "link.txt", "new")
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "real.txt").read_text() == "new"
    assert names(tmp_path) == ["link.txt", "real.txt"]


@pytest.mark.parametrize(("number", "said"), [(errno.ENOSPC, "no space left"), (errno.EACCES, "no permission")])
def test_what_the_system_refuses_is_one_sentence_and_leaves_nothing(tmp_path: Path, number: int, said: str) -> None:
    with pytest.raises(OutputError, match=f"x.csv: cannot be written, .*{said}"), atomic_path(tmp_path / "x.csv"):
        raise OSError(number, "refused")
    assert not names(tmp_path)


def test_a_second_process_is_refused_and_told_who_writes(tmp_path: Path) -> None:
    code = (
        "import sys, pathlib; from tipforce.io import write_atomic; from tipforce.errors import OutputError\n"
        "try: write_atomic(pathlib.Path(sys.argv[1]), 'other')\n"
        "except OutputError as error: print(error)"
    )
    words = [sys.executable, "-c", code, str(tmp_path / "x.csv")]
    with atomic_path(tmp_path / "x.csv") as part:
        part.write_text("mine")
        said = subprocess.run(words, capture_output=True, text=True, check=True).stdout
        write_atomic(tmp_path / "y.csv", "another file is free")
    assert f"is being written by process {os.getpid()}" in said
    assert (tmp_path / "x.csv").read_text() == "mine"
    subprocess.run(words, capture_output=True, text=True, check=True)
    assert (tmp_path / "x.csv").read_text() == "other"
