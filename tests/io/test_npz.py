"""Archives of arrays: what they claim is known before any memory is taken."""

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from tipforce._system.npz import read_npz
from tipforce.errors import FileFormatError


def saved(**arrays: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def archive(**members: bytes) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as made:
        for name, data in members.items():
            made.writestr(f"{name}.npy", data)
    return stream.getvalue()


def header(shape: str, kind: str = "<f8") -> bytes:
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".encode()
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


def test_arrays_come_back_as_they_were(tmp_path: Path) -> None:
    arrays = {
        "a": np.arange(6.0).reshape(2, 3),
        "b": np.asfortranarray(np.eye(3, dtype=np.float32)),
        "text": np.array("{}"),
        "none": np.empty((0, 3)),
        "flags": np.array([True, False]),
    }
    (tmp_path / "a.npz").write_bytes(saved(**arrays))
    for source in (tmp_path / "a.npz", saved(**arrays)):
        found = read_npz(source, "a.npz")
        assert set(found) == set(arrays)
        for name, array in arrays.items():
            assert found[name].dtype == array.dtype
            np.testing.assert_array_equal(found[name], array)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (
            archive(a=header("(1000000, 1000000)") + bytes(8)),
            r"claims the shape \(1000000, 1000000\) of float64, but has 8",
        ),
        (archive(a=header("(-1, -1)") + bytes(8)), "claims the shape"),
        (archive(a=header("(1,)", "|O") + bytes(8)), "claims the shape"),
        (archive(a=b"no array"), "no readable arrays"),
        (archive(a=header("(" + "(" * 5000)), "no readable arrays"),
        (b"no archive", "no readable arrays"),
        (b"", "no readable arrays"),
        (saved(a=np.zeros(9 << 20)), r"would unpack to 75\d+ bytes, but a file of \d+ bytes may to 67108864"),
    ],
    ids=["claim", "negative", "objects", "text", "brackets", "no-zip", "empty", "bomb"],
)
def test_what_claims_more_than_it_has_is_refused(data: bytes, said: str) -> None:
    with pytest.raises(FileFormatError, match=f"^x.npz: .*{said}"):
        read_npz(data, "x.npz")


def test_a_changed_number_is_found_by_its_checksum() -> None:
    data = bytearray(archive(a=header("(1,)") + bytes(8)))
    stored = io.BytesIO()
    np.savez(stored, a=np.arange(100.0))
    data = bytearray(stored.getvalue())
    data[len(data) // 2] ^= 1
    with pytest.raises(FileFormatError, match="CRC"):
        read_npz(bytes(data), "x.npz")
