"""Files are written whole or not at all."""

import pytest

from ellipseg_ros.errors import InputError
from ellipseg_ros.io.atomic_files import replacing, write_text


def test_failed_write_leaves_the_file_unchanged(tmp_path):
    path = tmp_path / "text"
    write_text(path, "one")

    def interrupted():
        with replacing(path) as part:
            part.write_text("two")
            raise KeyError

    with pytest.raises(KeyError):
        interrupted()
    assert path.read_text() == "one"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", ["file/inside", "missing/inside", "x" * 300])
def test_unwritable_path_is_one_line(tmp_path, name):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="can't be written: "):
        write_text(tmp_path / name, "text")
