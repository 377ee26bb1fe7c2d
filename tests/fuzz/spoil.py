"""What may happen to a file: seeded changes of bytes, text, JSON values and archives.

A calm `Spoiler` changes nothing, so that every case can also be run on good input.
"""

import copy
import io
import json
import random
import re
import zipfile
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")

NUMBERS = (
    "0", "-0", "-1", "1", "2", "0.5", "1e-300", "1e300", "1e308", "1e309", "-1e309", "nan", "NaN", "inf", "-inf", "1e9",
    "1e18", "1e19", "2147483648", "4294967296", "9223372036854775807", "9223372036854775808", "-9223372036854775809",
    "18446744073709551616", "1" + "0" * 400, "1_000", "0x10", "1,5", "１２", "", " ", "1e", "--1", "None", "true",
)  # fmt: skip
"""Texts in place of a number."""
VALUES: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 2**31, 2**53, 2**63, 2**64, -(2**63) - 1, 10**400, 1e-300, 1e300, -1e300, 0.5, "", "a",
    "x" * 5000, "\x00", "\x1b[2J\x1b]0;owned\x07", "a\nb", "\u202e", "../outside", "/dev/zero", "NaN", [], {}, [[]],
    {"a": {}}, [1, 2], [0, 0, 0, 0], [1e9, 0, 2e9, 1], [-5, -5, 5, 5], ["a", 1], [None],
)  # fmt: skip
"""Values in place of one in JSON or TOML; not a number and infinity stand apart, since TOML has them and JSON not."""
STRINGS = (
    "", " ", "\t", "\x00", "\x1b[31mred\x1b[0m", "a\r\nb", "\u2028", "\ufeff", '"', "'", "=1+1", "x" * 5000, "é" * 300,
    "../../outside", "/dev/zero", "\ud800", "%s%n", "{}", "[bold]", "\u202eabc",
)  # fmt: skip
"""Texts in place of a word."""
SIZES = (0, 1, 2, 3, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x10000, 0xFFFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
"""Numbers in place of a length in a binary file; the 64-bit ones are these and their complements."""


class Spoiler:
    """Changes things by chance; the same seed changes the same things in the same way."""

    def __init__(self, seed: str, calm: bool = False) -> None:
        self.dice = random.Random(seed)
        self.calm = calm

    def one_of(self, first: T, *others: T) -> T:
        """``first`` where calm."""
        return first if self.calm else self.dice.choice((first, *others))

    def chance(self, share: float) -> bool:
        """Never where calm."""
        return not self.calm and self.dice.random() < share

    # bytes

    def data(self, data: bytes) -> bytes:
        """One to four changes of ``data``, whatever they mean."""
        for _ in range(0 if self.calm else self.dice.choice((1, 1, 1, 2, 4))):
            data = self.dice.choice(_OF_BYTES)(self.dice, data)
        return data

    def number_at(self, data: bytes, at: int, size: int, order: str) -> bytes:
        """``data`` with another number of ``size`` bytes ``at``."""
        if self.calm:
            return data
        return data[:at] + _size(self.dice, size, order) + data[at + size :]

    # text

    def text(self, text: str) -> str:
        """One to three changes of a text of lines, numbers and words."""
        for _ in range(0 if self.calm else self.dice.choice((1, 1, 2, 3))):
            text = self.dice.choice(_OF_TEXT)(self.dice, text)
        return text

    def encoded(self, text: str) -> bytes:
        """As UTF-8, now and then as something else."""
        data = text.encode("utf-8", "surrogatepass")
        if self.chance(0.06):
            return self.dice.choice((b"\xff\xfe", b"\xef\xbb\xbf", b"\x00")) + data
        if self.chance(0.03):
            return text.encode("utf-16", "surrogatepass")
        return self.data(data) if self.chance(0.1) else data

    # JSON

    def value(self, value: Any) -> Any:
        """A copy of a JSON value with one to three of its parts replaced, removed, doubled or renamed."""
        value = copy.deepcopy(value)
        for _ in range(0 if self.calm else self.dice.choice((1, 1, 1, 2, 3))):
            places = list(_places(value))
            if not places:
                return self.dice.choice(VALUES)
            holder, key = self.dice.choice(places)
            what = self.dice.random()
            if what < 0.6:
                holder[key] = self.strange_like(holder[key])
            elif what < 0.75:
                del holder[key]
            elif what < 0.85 and isinstance(holder, dict):
                holder[self.dice.choice(("", "a", "x" * 300, "__proto__", str(key).upper(), "\x1b[1m"))] = holder[key]
            elif what < 0.9:
                holder[key] = _deep(self.dice.choice((3, 30, 100)), holder[key])
            elif isinstance(holder, list):
                holder.insert(key, holder[key])
            else:
                other, at = self.dice.choice(places)
                holder[key] = copy.deepcopy(other[at])
        return value

    def strange_like(self, value: Any) -> Any:
        """Another value: a number mostly becomes another number."""
        if isinstance(value, (int, float)) and not isinstance(value, bool) and self.dice.random() < 0.6:
            factor = self.dice.choice((0, -1, 0.5, 2, 1e3, 1e-3, 1e12, 1e300)) if abs(value) < 1e300 else 1
            return self.dice.choice((value * factor, value + 1, value - 1, float("nan"), float("inf")))
        return copy.deepcopy(self.dice.choice((*VALUES, float("nan"), float("inf"))))

    def as_json(self, value: Any) -> bytes:
        """The value as a person or an attacker would write it down."""
        text = json.dumps(value, indent=self.one_of(2, None), ensure_ascii=self.one_of(False, True))
        return text.encode("utf-8", "surrogatepass")

    # archives of arrays

    def arrays(self, arrays: dict[str, Any]) -> bytes:
        """``arrays`` as .npz, with one to three of them changed in shape, type or content."""
        arrays = dict(arrays)
        for _ in range(0 if self.calm else self.dice.choice((1, 1, 2, 3))):
            if not arrays:
                break
            name = self.dice.choice(sorted(arrays))
            try:
                arrays[name] = self._array(np.asarray(arrays[name]))
            except (TypeError, ValueError, OverflowError):
                continue  # text does not become a number
            if self.dice.random() < 0.1:
                arrays[self.dice.choice(("x", "../x", "shift", ""))] = arrays.pop(name)
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=True, **arrays)
        data = buffer.getvalue()
        if self.chance(0.2):
            data = self._header(data)
        return self.data(data) if self.chance(0.15) else data

    def _array(self, array: np.ndarray) -> np.ndarray:
        dice = self.dice
        kind = dice.randrange(9)
        with np.errstate(all="ignore"):
            if kind == 0:
                return array[: dice.randrange(len(array) + 1)] if array.ndim else array
            if kind == 1:
                return array.reshape(-1)
            if kind == 2:
                return array[None]
            if kind == 3 and array.size:
                changed = np.array(array)
                strange = (0, -1, 1, 127, 2**31 - 1, -(2**31), np.nan, np.inf, 1e300)
                changed.flat[dice.randrange(changed.size)] = np.array(dice.choice(strange)).astype(array.dtype)
                return changed
            if kind == 4:
                return array.astype(dice.choice(("f4", "i1", "u8", "c16", "?", "U7", "f8", "i8")))
            if kind == 5:
                return np.array(["a", {}], dtype=object)
            if kind == 6:
                return np.zeros(dice.choice(((0,), (), (1,), (3, 0), (7, 7, 7), (100_000,))), array.dtype)
            if kind == 7 and array.ndim > 1:
                return np.asfortranarray(array.T)
            return np.concatenate([array.reshape(-1)] * 2)

    def _header(self, data: bytes) -> bytes:
        """One member of an archive says a shape or type that its bytes do not have."""
        shape = self.dice.choice(
            ("(1000000000000,)", "(-1,)", "(0,)", "(99999999999999999999,)", "(1, 2, 3)", "()", "x")
        )

        def change(name: str, content: bytes) -> bytes:
            del name
            return re.sub(rb"\([0-9, ]*\)(?=, \})", shape.encode(), content, count=1)

        return self.archive(data, change)

    def archive(self, data: bytes, change: Callable[[str, bytes], bytes]) -> bytes:
        """A zip file with one member changed."""
        with zipfile.ZipFile(io.BytesIO(data)) as old:
            members = [(name, old.read(name)) for name in old.namelist()]
        chosen = self.dice.randrange(len(members))
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", self.dice.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as new:
            for k, (name, content) in enumerate(members):
                new.writestr(name, change(name, content) if k == chosen else content)
        return buffer.getvalue()


def _size(dice: random.Random, size: int, order: str) -> bytes:
    value = dice.choice(SIZES)
    if size == 8 and dice.random() < 0.5:
        value = (1 << 64) - 1 - value
    return (value & ((1 << (8 * size)) - 1)).to_bytes(size, order)  # type: ignore[arg-type]


def _span(dice: random.Random, data: bytes | str, most: int = 64) -> tuple[int, int]:
    start = dice.randrange(len(data) + 1)
    return start, min(len(data), start + dice.choice((1, 4, 16, most, len(data))))


def _flip(dice: random.Random, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(dice.choice((1, 1, 8, 64))):
        if changed:
            changed[dice.randrange(len(changed))] ^= 1 << dice.randrange(8)
    return bytes(changed)


def _flip_head(dice: random.Random, data: bytes) -> bytes:
    return _flip(dice, data[:256]) + data[256:]


def _cut(dice: random.Random, data: bytes) -> bytes:
    return data[: dice.choice((0, 1, 4, len(data) // 2, len(data) - 1, dice.randrange(len(data) + 1)))]


def _remove(dice: random.Random, data: bytes) -> bytes:
    start, end = _span(dice, data)
    return data[:start] + data[end:]


def _splice(dice: random.Random, data: bytes) -> bytes:
    start, end = _span(dice, data)
    place = dice.randrange(len(data) + 1)
    return data[:place] + data[start:end] + data[place + dice.choice((0, end - start)) :]


def _repeat(dice: random.Random, data: bytes) -> bytes:
    start, end = _span(dice, data)
    return data[:end] + data[start:end] * dice.choice((1, 3, 100)) + data[end:] if end - start < 4096 else data + data


def _overflow(dice: random.Random, data: bytes) -> bytes:
    size = dice.choice((2, 4, 8))
    at = dice.randrange(dice.choice((1, 64, len(data) + 1, len(data) + 1)))
    return data[:at] + _size(dice, size, dice.choice(("little", "big"))) + data[at + size :]


def _fill(dice: random.Random, data: bytes) -> bytes:
    start, end = _span(dice, data, 1024)
    return data[:start] + bytes([dice.choice((0, 0xFF, 0x20, 0x41))]) * (end - start) + data[end:]


def _noise(dice: random.Random, data: bytes) -> bytes:
    start, end = _span(dice, data)
    return data[:start] + dice.randbytes(end - start) + data[end:]


_OF_BYTES: Sequence[Callable[[random.Random, bytes], bytes]] = (
    _flip, _flip, _flip_head, _cut, _remove, _splice, _repeat, _overflow, _overflow, _fill, _noise,
)  # fmt: skip

_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def _another_number(dice: random.Random, text: str) -> str:
    found = list(_NUMBER.finditer(text))
    if not found:
        return text + dice.choice(NUMBERS)
    here = dice.choice(found)
    return text[: here.start()] + dice.choice(NUMBERS) + text[here.end() :]


def _a_column_of_numbers(dice: random.Random, text: str) -> str:
    """The same number of every line becomes the same other one, or grows by some orders."""
    which, other = dice.randrange(5), dice.choice((*NUMBERS, None, None))
    zeros = "0" * dice.choice((1, 3, 9, 18, 300))
    lines = text.split("\n")
    for at, line in enumerate(lines[1:], 1):
        found = list(_NUMBER.finditer(line))
        if which < len(found):
            here = found[which]
            lines[at] = line[: here.start()] + (here[0] + zeros if other is None else other) + line[here.end() :]
    return "\n".join(lines)


def _another_word(dice: random.Random, text: str) -> str:
    found = list(re.finditer(r"[A-Za-z_]+", text))
    if not found:
        return text + dice.choice(STRINGS)
    here = dice.choice(found[: dice.choice((6, len(found)))])
    word = dice.choice((*STRINGS, dice.choice(found)[0], here[0].upper(), here[0] + "_s"))
    return text[: here.start()] + word + text[here.end() :]


def _lines(dice: random.Random, text: str) -> str:
    lines = text.split("\n")
    start, end = _span(dice, lines)  # type: ignore[arg-type]
    way = dice.randrange(6)
    if way == 0:
        del lines[start:end]
    elif way == 1:
        lines[start:start] = lines[start:end]
    elif way == 2:
        lines[start:end] = reversed(lines[start:end])
    elif way == 3:
        lines = lines[:1]
    elif way == 4:
        lines.insert(start, dice.choice(STRINGS))
    else:
        dice.shuffle(lines)
    return "\n".join(lines)


def _separators(dice: random.Random, text: str) -> str:
    old, new = dice.choice(
        ((",", ";"), (",", "\t"), (",", ",,"), (".", ","), ("\n", "\r"), ("\n", "\n\n"), ("\n", "\0"))
    )
    return text.replace(old, new, dice.choice((1, -1)))


def _insert(dice: random.Random, text: str) -> str:
    at = dice.randrange(len(text) + 1)
    return text[:at] + dice.choice((*STRINGS, "," * 300, '"' * 3, "[" * 2000, "\n" * 50)) + text[at:]


def _cut_text(dice: random.Random, text: str) -> str:
    return text[: dice.randrange(len(text) + 1)]


_OF_TEXT: Sequence[Callable[[random.Random, str], str]] = (
    _another_number, _another_number, _a_column_of_numbers, _another_word, _lines, _separators, _insert, _cut_text,
)  # fmt: skip


def _places(value: Any) -> Any:
    """Every (holder, key) in a JSON value."""
    if isinstance(value, dict):
        for key in list(value):
            yield value, key
            yield from _places(value[key])
    elif isinstance(value, list):
        for key in range(min(len(value), 50)):
            yield value, key
            yield from _places(value[key])


def _deep(times: int, value: Any) -> Any:
    for _ in range(times):
        value = [value]
    return value
