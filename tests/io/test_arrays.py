"""Archives of arrays: numpy and any ZIP program read what is written at once, as we do."""

from __future__ import annotations

from io import BytesIO
from zipfile import ZipFile

import numpy as np
import pytest

from sldvexp.io import arrays
from sldvexp.io.arrays import read_arrays, write_arrays

KEPT = {
    "counts": np.arange(600, dtype=np.int16).reshape(3, 2, 100),
    "rate": np.array(25600.0),
    "status": np.array([0, 1, 2], np.uint8),
    "none": np.zeros((0, 2)),
    "turned": np.arange(6.0).reshape(2, 3).T,
    "sums": np.array([1 + 2j, np.nan]),
    "big_endian": np.arange(3, dtype=">i4"),
}


@pytest.mark.parametrize("largest", [arrays.LARGEST, 100])
def test_arrays_are_read_as_they_were(tmp_path, monkeypatch, largest):
    """Also those that are left to numpy because they are too large."""
    monkeypatch.setattr(arrays, "LARGEST", largest)
    path = tmp_path / "line.npz"
    with path.open("wb") as file:
        write_arrays(file, **KEPT)
    with np.load(path) as kept:
        assert kept.files == list(KEPT)
        for name, array in KEPT.items():
            np.testing.assert_array_equal(kept[name], array)
            assert (kept[name].dtype, kept[name].shape) == (array.dtype, array.shape)


def test_the_archive_is_sound(tmp_path):
    """Every entry has its checksum, and is where and what numpy would have written."""
    ours, numpys = tmp_path / "ours.npz", tmp_path / "numpys.npz"
    with ours.open("wb") as file:
        write_arrays(file, **KEPT)
    np.savez(numpys, **KEPT)
    with ZipFile(ours) as one, ZipFile(numpys) as other:
        assert one.testzip() is None
        assert one.namelist() == other.namelist()
        for name in set(one.namelist()) - {"turned.npy"}:
            assert one.read(name) == other.read(name)


@pytest.fixture
def written():
    file = BytesIO()
    write_arrays(file, **KEPT)
    return file.getvalue()


def test_what_is_written_is_read_at_once(written):
    found = read_arrays(written)
    assert list(found) == list(KEPT)
    for name, array in KEPT.items():
        np.testing.assert_array_equal(found[name], array)
        assert (found[name].dtype, found[name].shape) == (array.dtype, array.shape)
        assert found[name].flags.writeable


def test_no_damage_is_read_at_once(written):
    """Whichever byte is another, and wherever it is cut off; numpy looks at it then."""
    for place in range(len(written)):
        changed = bytearray(written)
        changed[place] ^= 1
        assert read_arrays(bytes(changed)) is None, place
        assert read_arrays(written[:place]) is None, place
    assert read_arrays(written + b"\0") is None


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed, np.save])
def test_other_archives_are_left_to_numpy(save):
    file = BytesIO()
    save(file, np.arange(3))
    assert read_arrays(file.getvalue()) is None
