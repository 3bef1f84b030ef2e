"""Build and install ellipseg_ros, with pip or with colcon.

ROS has no ament_python package that defines messages: the convention is a separate message package
built by CMake. Here setup.py runs that CMake build, so that the nodes and their messages are one
package and `pip install .` works without a ROS installation.
"""

import os
import shutil
import subprocess
import sys
from glob import glob
from pathlib import Path
from xml.etree import ElementTree

from setuptools import Distribution, find_packages, setup
from setuptools.command.build_ext import build_ext

NAME = "ellipseg_ros"
ROOT = Path(__file__).resolve().parent  # colcon runs a symlink of this file in its build folder
MANIFEST = ElementTree.parse(ROOT / "package.xml").getroot()  # the one place of the version

NODES = {
    "associator": "ellipseg_ros.ros.start:associator",
    "replayer": "ellipseg_ros.ros.start:replayer",
    "segmenter": "ellipseg_ros.ros.start:segmenter",
}
COMMANDS = {
    "ellipseg": "ellipseg_ros.cli.main:program",
}

# Generated files with these prefixes are installed below the install prefix.
GENERATED = (
    "bin/",
    "include/",
    "lib/",
    f"share/{NAME}/cmake/",
    f"share/{NAME}/msg/",
    "share/ament_index/resource_index/rosidl_interfaces/",
)

# Readers of .las, .laz, .pcd and .ply files.
FILES = ["laspy[lazrs]", "pypcd4", "trimesh"]
# Charts and pictures of the command line and of the studies.
PLOTS = ["matplotlib", "pillow"]
# Libraries that `python -m studies.benchmark` and `python -m studies.partition` compare with
# (600 MB). PCL's region growing is not among them: it has no wheels.
PEERS = [
    "cut-pursuit-py",
    "hdbscan",
    "open3d-cpu",
    "pgeof",
    "scipy>=1.15",
    "small_gicp",
]
DASK = ["distributed"]  # `ellipseg tune --scheduler`
ODOMETRY = ["kiss-icp"]  # `--odometry kiss-icp` of the command line


class BinaryDistribution(Distribution):
    """Distribution with compiled code, which CMake builds and setuptools cannot detect."""

    def has_ext_modules(self):
        return True

    has_data = Distribution.has_data_files  # the name that `pip install -e` calls


class BuildMessages(build_ext):
    """Generate and compile the messages with CMakeLists.txt, then install them."""

    def run(self):
        stage = Path(self.build_temp).resolve() / "stage"
        shutil.rmtree(stage, ignore_errors=True)
        self.run_cmake(stage)
        self.write_scripts(stage)

        # Python code goes beside the other modules; into the checkout for `pip install -e` and
        # `colcon build --symlink-install`.
        package = (ROOT if self.inplace else Path(self.build_lib)) / NAME
        generated = stage / "python" / NAME
        shutil.rmtree(package / "msg", ignore_errors=True)
        ignored = shutil.ignore_patterns("*.c", "__pycache__")
        shutil.copytree(generated / "msg", package / "msg", ignore=ignored)
        for library in generated.glob("*.so"):
            shutil.copy2(library, package)

        # Other files go below the install prefix, where ROS, C++ packages and the loader search.
        for path in sorted(stage.rglob("*")):
            target = path.relative_to(stage)
            if path.is_file() and str(target).startswith(GENERATED):
                self.distribution.data_files.append((str(target.parent), [os.path.relpath(path)]))

    def run_cmake(self, stage):
        """Run CMake and install the generated code to the folder `stage`."""
        try:
            import ament_package  # installed in the prefix of ROS: from PyPI, apt or source
        except ModuleNotFoundError as error:
            raise SystemExit(
                "ellipseg_ros: ROS 2 was not found; source its setup.bash before colcon, "
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
        """Add the scripts that the installer omits.

        pip installs all scripts in bin/, but `ros2 run` and launch files search lib/<package>/;
        colcon installs all of them there (setup.cfg), but a shell searches bin/.
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
    version=MANIFEST.findtext("version"),
    description="Online segmentation of lidar streams into ellipsoids, for ROS 2.",
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
        "numba>=0.60,<0.69",  # the versions that were tested: CONTRIBUTING.md
        "numpy",
        "ros-jazzy-builtin-interfaces",
        "ros-jazzy-diagnostic-msgs",
        "ros-jazzy-geometry-msgs",
        "ros-jazzy-nav-msgs",
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
        "files": FILES,
        "plots": PLOTS,
        "page": PLOTS,  # pages of docs/results, written by the studies
        "peers": PEERS,
        "dask": DASK,
        "odometry": ODOMETRY,
        "slam": ["gtsam"],  # examples/close_loop.py
        "docs": ["furo", "myst-parser", "sphinx"],  # `make docs`
        # Tests and the demo; they run colcon, so they also need the build requirements of
        # pyproject.toml; `make setup` installs both. mypy and ruff are pinned because their
        # checks differ between versions.
        "test": [
            *FILES,
            *PLOTS,
            *DASK,
            *ODOMETRY,
            "codespell",
            "colcon-common-extensions",
            "coverage",
            "hypothesis",
            "markdown-it-py",
            "mypy==2.4.1",
            "pytest",
            "pytest-cov",
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
