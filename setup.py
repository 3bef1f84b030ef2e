"""Builds and installs ellipseg_ros, by pip and by colcon alike.

An ament_python package can't define messages by the usual means: the ROS way is a package of
their own, built by CMake. Here setup.py runs that CMake build, so that the node and its messages
are one package, and `pip install .` works without a ROS installation.
"""

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
    "associator": "ellipseg_ros.ros.start:associator",
    "replayer": "ellipseg_ros.ros.start:replayer",
    "segmenter": "ellipseg_ros.ros.start:segmenter",
}
COMMANDS = {
    "ellipseg": "ellipseg_ros.cli.main:program",
}

# What of the generated code belongs below the install prefix.
GENERATED = (
    "bin/",
    "include/",
    "lib/",
    f"share/{NAME}/cmake/",
    f"share/{NAME}/msg/",
    "share/ament_index/resource_index/rosidl_interfaces/",
)


class BinaryDistribution(Distribution):
    """Has compiled code, which setuptools can't tell by itself: CMake compiles it."""

    def has_ext_modules(self):
        return True

    has_data = Distribution.has_data_files  # `pip install -e` asks by this name


class BuildMessages(build_ext):
    """Generates and compiles the messages as CMakeLists.txt says, and installs them."""

    def run(self):
        stage = Path(self.build_temp).resolve() / "stage"
        shutil.rmtree(stage, ignore_errors=True)
        self.run_cmake(stage)
        self.write_scripts(stage)

        # Python: beside the hand-written modules; in the checkout for `pip install -e` and
        # `colcon build --symlink-install`.
        package = (ROOT if self.inplace else Path(self.build_lib)) / NAME
        generated = stage / "python" / NAME
        shutil.rmtree(package / "msg", ignore_errors=True)
        ignored = shutil.ignore_patterns("*.c", "__pycache__")
        shutil.copytree(generated / "msg", package / "msg", ignore=ignored)
        for library in generated.glob("*.so"):
            shutil.copy2(library, package)

        # The rest: below the install prefix, where ROS, C++ packages and the loader look.
        for path in sorted(stage.rglob("*")):
            target = path.relative_to(stage)
            if path.is_file() and str(target).startswith(GENERATED):
                self.distribution.data_files.append((str(target.parent), [os.path.relpath(path)]))

    def run_cmake(self, stage):
        """Let CMake install the generated code to the folder `stage`."""
        try:
            import ament_package  # lies in the prefix of ROS: from PyPI, apt or source
        except ModuleNotFoundError as error:
            raise SystemExit(
                "ellipseg_ros: no ROS 2 to build with; source its setup.bash before colcon, "
                "or use pip without --no-build-isolation"
            ) from error

        prefix = str(Path(ament_package.__file__).parents[4])
        env = dict(os.environ)
        for name in ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH"):
            env[name] = os.pathsep.join(filter(None, [env.get(name), prefix]))
        env.setdefault("CMAKE_BUILD_PARALLEL_LEVEL", str(os.cpu_count()))

        build = Path(self.build_temp).resolve() / "cmake"
        cache = build / "CMakeCache.txt"
        if cache.exists() and prefix not in cache.read_text():
            shutil.rmtree(build)  # pip's build isolation has a new prefix each time
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

    def write_scripts(self, stage):
        """Add the scripts that the installer doesn't put where they are looked for.

        pip puts all of them in bin/, but `ros2 run` and launch files look in lib/<package>/;
        colcon puts all of them there (setup.cfg), but a shell looks in bin/.
        """
        by_pip = self.distribution.get_command_obj("bdist_wheel", create=False)
        folder, scripts = (f"lib/{NAME}", NODES) if by_pip else ("bin", COMMANDS)
        (stage / folder).mkdir(parents=True, exist_ok=True)
        for name, place in scripts.items():
            module, function = place.split(":")
            script = stage / folder / name
            script.write_text(
                "#!/usr/bin/env python3\n"
                f"import sys\n\nfrom {module} import {function}\n\nsys.exit({function}())\n"
            )
            script.chmod(0o755)


setup(
    name=NAME,
    version="0.1.0",
    description="Segments a registered lidar stream into ellipsoids while the vehicle drives.",
    maintainer="ellipseg_ros maintainers",
    maintainer_email="maintainers@ellipseg.example.com",
    license="Apache-2.0",
    # Without the generated msg/, which an editable install leaves in the checkout.
    packages=find_packages(str(ROOT), include=[NAME, f"{NAME}.*"], exclude=[f"{NAME}.msg*"]),
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", sorted(glob("config/*.yaml") + glob("config/*.rviz"))),
        (f"share/{NAME}/config/sros2", sorted(glob("config/sros2/*.xml"))),
        (f"share/{NAME}/launch", sorted(glob("launch/*.py"))),
    ],
    python_requires=">=3.10",
    install_requires=[
        "PyYAML",
        "laspy[lazrs]",
        "matplotlib",
        "numba",
        "numpy",
        "pillow",
        "pypcd4",
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
        "tqdm",
        "trimesh",
    ],
    extras_require={
        # `ellipseg bench` compares with these; what is not there it names. 600 MB, so `make setup`
        # leaves them out, but for the small ones, which are among those of the tests.
        "bench": [
            "hdbscan",
            "open3d-cpu",
            "scipy>=1.15",
            "small_gicp",
        ],
        "dask": ["distributed"],  # `ellipseg tune --scheduler`
        # `ellipseg evaluate partition` compares with these, as large again. PCL's region
        # growing is not among them: it has no wheels.
        "evaluate": [
            "cut-pursuit-py",
            "hdbscan",
            "open3d-cpu",
            "pgeof",
            "scipy>=1.15",
        ],
        "slam": ["gtsam"],  # examples/close_loop.py
        # The tests run colcon, so they need the build requirements of pyproject.toml too; `make
        # setup` installs both. Other versions of mypy and ruff have other opinions.
        "test": [
            "colcon-common-extensions",
            "distributed",
            "hypothesis",
            "mypy==2.4.1",
            "pytest",
            "pytest-xdist",
            "ruff==0.17.6",
            "scipy>=1.15",
            "small_gicp",
        ],
    },
    entry_points={
        "console_scripts": [f"{name} = {place}" for name, place in (NODES | COMMANDS).items()],
    },
    distclass=BinaryDistribution,
    cmdclass={"build_ext": BuildMessages},
    zip_safe=False,
)
