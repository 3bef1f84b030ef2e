import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ellipseg_ros.errors import InputError
from ellipseg_ros.io.pose_files import read_pose_file

STAMPS = [10**9, 2 * 10**9]


def written(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def refused(path, text, stamps=STAMPS):
    with pytest.raises(InputError) as error:
        read_pose_file(written(path, text), stamps)
    message = str(error.value)
    assert str(path) in message and len(message.splitlines()) == 1
    return message


def test_tum_file_is_read_with_comments_and_blank_lines(tmp_path):
    text = (
        "# time x y z qx qy qz qw\n1700000000.25 1 2 3 0 0 0.6 0.8\n\n1700000000.5 4 5 6 0 0 0 1"
    )
    stamps = (1 / 0 for _ in STAMPS)  # are not needed, and not read
    first, second = read_pose_file(written(tmp_path / "poses.tum", text), stamps)
    assert first[:3] == (1_700_000_000_250_000_000, "odom", "")
    np.testing.assert_array_equal(first.pose.position, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(first.pose.rotation, [0.0, 0.0, 0.6, 0.8], atol=1e-15)
    assert second.time_ns == 1_700_000_000_500_000_000


def test_kitti_file_has_a_pose_for_each_cloud(tmp_path):
    rng = np.random.default_rng(0)
    matrices = [np.column_stack([Rotation.random(rng=rng).as_matrix(), [k, 2, 3]]) for k in (0, 1)]
    text = "\n".join(" ".join(f"{x:.17g}" for x in m.ravel()) for m in matrices)
    found = read_pose_file(written(tmp_path / "poses.txt", text), iter(STAMPS))
    assert [sample.time_ns for sample in found] == STAMPS
    for sample, matrix in zip(found, matrices, strict=True):
        np.testing.assert_allclose(sample.pose.matrix[:3], matrix, atol=1e-12)


def test_files_of_another_form_are_refused(tmp_path):
    tum, kitti = tmp_path / "poses.tum", tmp_path / "poses.txt"
    assert "no poses" in refused(tum, "")
    assert "no poses" in refused(tum, "# time x y z qx qy qz qw\n")
    assert "7 numbers" in refused(tum, "1 0 0 0 0 0 1\n")
    assert "8 (TUM) or 12 numbers" in refused(tum, "1 0 0 0 0 0 0 1\n2 0 0\n")
    assert "8 (TUM) or 12 numbers" in refused(tum, "1,0,0,0,0,0,0,1\n")
    assert "pose 2" in refused(tum, "1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 2\n")
    assert "pose 1" in refused(tum, "1 0 nan 0 0 0 0 1\n")
    for time in ("nan", "inf", "1e300", "1700000000000000000"):
        assert "time is" in refused(tum, f"{time} 0 0 0 0 0 0 1\n")
    assert "1 poses for 2 clouds" in refused(kitti, "1 0 0 0 0 1 0 0 0 0 1 0\n")
    text = "1 0 0 0 0 1 0 0 0 0 1 0\n2 0 0 0 0 1 0 0 0 0 1 0\n"
    assert "pose 2" in refused(kitti, text)
    tum.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="can't be read as poses"):
        read_pose_file(tum, STAMPS)
