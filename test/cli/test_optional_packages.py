"""Library and command line without the optional packages, and without ROS."""

import subprocess
import sys

import numpy as np
import pytest

OPTIONAL = ("rclpy", "matplotlib", "PIL", "laspy", "lazrs", "pypcd4", "trimesh", "distributed")


def run_without(packages, code, *argv, **options):
    """Run a program in which the packages cannot be imported."""
    block = f"import sys\nfor name in {packages!r}:\n    sys.modules[name] = None\n"
    return subprocess.run(
        [sys.executable, "-c", block + code, *map(str, argv)],
        capture_output=True,
        text=True,
        timeout=300,
        **options,
    )


def ellipseg_without(packages, *argv, **options):
    """Run a command of `ellipseg` in the same way."""
    code = "from ellipseg_ros.cli.main import main\nsys.exit(main(sys.argv[1:]))\n"
    return run_without(packages, code, *argv, **options)


def test_library_segments_without_ros_and_optional_packages():
    code = (
        "import numpy as np\nimport ellipseg_ros\n"
        "points = np.random.default_rng(0).uniform(0.0, 3.0, (200, 3))\n"
        "result = ellipseg_ros.segment(points)\n"
        "segmenter = ellipseg_ros.Segmenter(ellipseg_ros.Config())\n"
        "again = segmenter.process(ellipseg_ros.Sweep(0, points))\n"
        "print(len(result.labels), len(again.labels))\n"
    )
    ended = run_without(OPTIONAL, code)
    assert (ended.returncode, ended.stdout) == (0, "200 200\n"), ended.stderr


def test_segment_runs_without_ros_and_optional_packages(tmp_path):
    words = ["segment", "sim:mixed", "--duration", "0.5", "--no-pictures", "-o", tmp_path / "out"]
    ended = ellipseg_without(OPTIONAL, *words, "-q")
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"bag", "summary.json", "window.npz", "window.ply"}


@pytest.mark.parametrize(
    ("package", "words", "text"),
    [
        ("trimesh", ["segment", "cloud.ply", "--no-pictures"], "ellipseg_ros[files]"),
        ("pypcd4", ["segment", "cloud.pcd", "--no-pictures"], "ellipseg_ros[files]"),
        ("laspy", ["segment", "cloud.las", "--no-pictures"], "ellipseg_ros[files]"),
        ("matplotlib", ["segment", "cloud.npz"], "ellipseg_ros[plots]"),
        ("PIL", ["demo"], "ellipseg_ros[plots]"),
        ("matplotlib", ["tune", "cloud.npz"], "ellipseg_ros[plots]"),
        ("rclpy", ["replay", "cloud.npz"], "needs ROS 2"),
    ],
)
def test_missing_package_is_named_with_its_extra(tmp_path, package, words, text):
    for name in ("cloud.ply", "cloud.pcd", "cloud.las"):
        (tmp_path / name).touch()
    np.savez(tmp_path / "cloud.npz", xyz=np.zeros((5, 3)))
    ended = ellipseg_without([package], *words, cwd=tmp_path)
    assert ended.returncode == 2
    assert ended.stderr.startswith("ellipseg: ") and ended.stderr.count("\n") == 1
    assert text in ended.stderr
    if package != "rclpy":
        assert f"needs the package {package}: pip install" in ended.stderr
