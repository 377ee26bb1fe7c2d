"""JSON and TOML from outside: limits of size and depth, one sentence each."""

import re
from pathlib import Path

import pytest

import tipforce
from tipforce._system.json_files import MAX_BYTES, MAX_DEPTH, parse_json, parse_json_lines, read_json
from tipforce.errors import FileFormatError, InputError
from tipforce.types import read_bench


def test_json_is_read_as_it_stands(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text('{"a": [1, 2.5, null]}')
    assert read_json(path) == {"a": [1, 2.5, None]}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"[" * 200_000, "nested more than"),
        (b'{"a":' * 200_000, "nested more than"),
        (b"[" * (MAX_DEPTH + 2) + b"]" * (MAX_DEPTH + 2), "nested more than"),
        (b"{", "is no JSON"),
        (b"\xff\xfe", "no text in UTF-8"),
        (b"1" * 5000, "is no JSON"),
        (b"[" + b" " * 2000 + b"]", "longer than"),
    ],
)
def test_what_is_no_json_for_this_program_is_one_sentence(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "a.json"
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match=f"^{re.escape(str(path))}: .*{said}") as caught:
        read_json(path, max_bytes=1024 if said == "longer than" else 1 << 22)
    assert "\n" not in str(caught.value)


def test_the_deepest_json_that_is_read() -> None:
    assert parse_json("[" * MAX_DEPTH + "]" * MAX_DEPTH, "here")


def test_the_remedy_ends_every_refusal(tmp_path: Path) -> None:
    for text in ("{", "[" * 200_000, "[" * (MAX_DEPTH + 2) + "]" * (MAX_DEPTH + 2), " " * (MAX_BYTES + 1)):
        with pytest.raises(FileFormatError, match=r"^here: .*; mend it$"):
            parse_json(text, "here", "mend it")
    (tmp_path / "a.json").write_bytes(b"\xff\xfe")
    for path in (tmp_path / "a.json", tmp_path, tmp_path / "none.json"):
        with pytest.raises(FileFormatError, match=r"; mend it$"):
            read_json(path, remedy="mend it")


def test_a_line_that_is_no_object_is_named() -> None:
    assert parse_json_lines('{"a": 1}\n{"a": 2}\n', "log") == [{"a": 1}, {"a": 2}]
    for second in ("[1]", "{", "[" * 100_000):
        with pytest.raises(FileFormatError, match=r"^log, line 2: .*; train anew$"):
            parse_json_lines('{"a": 1}\n' + second, "log", "train anew")


def test_json_is_read_through_one_gate_only() -> None:
    """But what the program wrote itself a moment before, in memory, and what stands on the command line."""
    others = {
        "cli/_settings.py",
        "simulation/_session_files.py",
        "simulation/world/_session.py",
        "_system/json_files.py",
    }
    source = Path(tipforce.__file__).parent
    used = {
        path.relative_to(source).as_posix()
        for path in source.rglob("*.py")
        if re.search(r"json\.loads?\(|model_validate_json", path.read_text(encoding="utf-8"))
    }
    assert used == others


def test_no_file_and_a_folder_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(FileFormatError, match="no such file"):
        read_json(tmp_path / "a.json")
    with pytest.raises(FileFormatError, match="no regular file"):
        read_json(tmp_path)


@pytest.mark.parametrize(
    "content",
    ["a = " + "[" * 20_000 + "]" * 20_000, "a = " + "{a=" * 20_000, "[" + "a." * 2_000 + "a]\nb = 1", "#" * (2 << 20)],
)
def test_a_bench_file_of_nonsense_is_one_sentence(tmp_path: Path, content: str) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(content)
    with pytest.raises(InputError, match=r"bench\.toml: "):
        read_bench(path)


def test_a_longer_file_is_read_where_more_is_allowed(tmp_path: Path) -> None:
    path = tmp_path / "long.json"
    path.write_text(f'["{"x" * MAX_BYTES}"]')
    with pytest.raises(FileFormatError, match="longer than 16 MiB"):
        read_json(path)
    assert len(read_json(path, max_bytes=2 * MAX_BYTES)[0]) == MAX_BYTES
