"""Files of arrays: all of one, or an error that says which file it is."""

import numpy as np
import pytest

from tuning.io import files


def test_arrays_come_back_as_they_were_written(tmp_path):
    wrote = {"a/b": np.arange(6.0).reshape(2, 3), "name": np.asarray("text"), "flags": np.array([True, False])}
    files.write_npz(tmp_path / "all.npz", wrote)
    read = files.read_npz(tmp_path / "all.npz")
    assert list(read) == list(wrote)
    for name, array in wrote.items():
        np.testing.assert_array_equal(read[name], array)
        assert read[name].dtype == array.dtype


def test_a_byte_that_changed_or_is_missing_is_an_error_that_names_the_file(tmp_path):
    path = tmp_path / "numbers.npz"
    files.write_npz(path, {"x": np.zeros(1000)})
    whole = path.read_bytes()
    middle = len(whole) // 2  # among the numbers
    for data in (whole[:-1], whole[:middle], b"", whole[:middle] + b"\x01" + whole[middle + 1 :]):
        path.write_bytes(data)
        with pytest.raises(ValueError, match="numbers.npz is cut short or damaged"):
            files.read_npz(path)
    path.unlink()
    with pytest.raises(OSError):
        files.read_npz(path)
    np.savez(path, x=np.array([{"code": "runs"}], dtype=object))
    with pytest.raises(ValueError, match="damaged"):
        files.read_npz(path)
