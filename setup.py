"""Builds ellipseg_ros, for pip and for colcon alike."""

import os
import shutil
import subprocess
import sys
from glob import glob
from pathlib import Path

from setuptools import Distribution, find_packages, setup
from setuptools.command.build_ext import build_ext

NAME = "ellipseg_ros"
ROOT = Path(__file__).resolve().parent  # colcon runs a symlink of this file in its build folder
NODES = {
    "segmenter": f"{NAME}.ros.segmenter_node:main",
    "replayer": f"{NAME}.ros.replayer:main",
}
TOOLS = {"ellipseg": f"{NAME}.cli.main:main"}
SCRIPTS = NODES | TOOLS


class BinaryDistribution(Distribution):
    """Has compiled code, which setuptools can't tell by itself: CMake compiles it."""

    def has_ext_modules(self):
        return True

    has_data = Distribution.has_data_files  # `pip install -e` asks by this name


class BuildMessages(build_ext):
    """Generates and compiles the messages, as CMakeLists.txt says, and installs them with the rest."""

    def run(self):
        stage = self.generate()

        # Python: beside the hand-written modules, in place for `pip install -e` and `--symlink-install`.
        package = (ROOT if self.inplace else Path(self.build_lib)) / NAME
        generated = stage / "python" / NAME
        shutil.rmtree(package / "msg", ignore_errors=True)
        shutil.copytree(
            generated / "msg", package / "msg", ignore=shutil.ignore_patterns("*.c", "__pycache__")
        )
        for library in generated.glob("*.so"):
            shutil.copy2(library, package)

        # The rest: below the install prefix, where ROS, C++ packages and the loader look.
        wanted = (
            "include/",
            "lib/",
            f"share/{NAME}/cmake/",
            f"share/{NAME}/msg/",
            "share/ament_index/resource_index/rosidl_interfaces/",
        )
        for path in stage.rglob("*"):
            target = path.relative_to(stage)
            if path.is_file() and str(target).startswith(wanted):
                self.distribution.data_files.append((str(target.parent), [os.path.relpath(path)]))

    def generate(self):
        """Return the folder that CMake has installed the generated code to."""
        import ament_package  # lies in the prefix of ROS, be it from PyPI, from apt or from source

        prefix = str(Path(ament_package.__file__).parents[4])
        env = dict(os.environ)
        for name in ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH"):
            env[name] = os.pathsep.join(filter(None, [env.get(name), prefix]))
        env.setdefault("CMAKE_BUILD_PARALLEL_LEVEL", str(os.cpu_count()))

        build = Path(self.build_temp).resolve() / "cmake"
        stage = Path(self.build_temp).resolve() / "stage"
        shutil.rmtree(stage, ignore_errors=True)
        cache = build / "CMakeCache.txt"
        if cache.exists() and prefix not in cache.read_text():  # pip's isolation has a new one each time
            shutil.rmtree(build)
        if not (build / "cmake_install.cmake").exists():
            options = {
                "BUILD_TESTING": "OFF",
                "CMAKE_BUILD_TYPE": "Release",
                "CMAKE_INSTALL_PREFIX": stage,
                "PYTHON_INSTALL_DIR": "python",
                "Python3_EXECUTABLE": sys.executable,
            }
            defines = [f"-D{key}={value}" for key, value in options.items()]
            subprocess.run(["cmake", "-S", ROOT, "-B", build, *defines], env=env, check=True)
        subprocess.run(["cmake", "--build", build, "--target", "install"], env=env, check=True)

        return stage


setup(
    name=NAME,
    version="0.1.0",
    description="Online ellipsoid segmentation of lidar point clouds.",
    maintainer="ellipseg_ros maintainers",
    maintainer_email="maintainers@ellipseg.example.com",
    license="Apache-2.0",
    # An in-place msg/ is generated and comes by BuildMessages.
    packages=find_packages(str(ROOT), include=[NAME, f"{NAME}.*"], exclude=[f"{NAME}.msg*"]),
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", glob("config/*.yaml") + glob("config/*.rviz")),
        (f"share/{NAME}/launch", glob("launch/*.py")),
    ],
    python_requires=">=3.10",
    install_requires=[
        "matplotlib",
        "numba",
        "numpy",
        "ros-jazzy-builtin-interfaces",
        "ros-jazzy-diagnostic-msgs",
        "ros-jazzy-geometry-msgs",
        "ros-jazzy-rcl-interfaces",
        "ros-jazzy-rclpy[fastrtps]",
        "ros-jazzy-rosgraph-msgs",
        "ros-jazzy-rosidl-default-runtime",
        "ros-jazzy-sensor-msgs",
        "ros-jazzy-std-msgs",
        "ros-jazzy-std-srvs",
        "ros-jazzy-visualization-msgs",
        "rosbags",
        "scipy",
        "tqdm",
    ],
    extras_require={
        "bench": [
            "small_gicp",
        ],
        "test": [
            "colcon-common-extensions",
            "hypothesis",
            "mypy",
            "pytest",
            "pytest-xdist",
            "ruff",
        ],
    },
    entry_points={"console_scripts": [f"{name} = {target}" for name, target in SCRIPTS.items()]},
    distclass=BinaryDistribution,
    cmdclass={"build_ext": BuildMessages},
    zip_safe=False,
)
