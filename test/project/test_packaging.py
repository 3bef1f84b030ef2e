"""The package's description agrees with itself and with the code."""

import ast
import re
import runpy
import sys
import tokenize
from pathlib import Path
from xml.etree import ElementTree

import pytest
import setuptools

ROOT = Path(__file__).resolve().parents[2]
SOURCES = sorted(
    path for path in (ROOT / "ellipseg_ros").rglob("*.py") if path.parent.name != "msg"
)
LAUNCH_FILES = sorted((ROOT / "launch").glob("*.py"))
TESTS = sorted((ROOT / "test").rglob("*.py"))
MESSAGES = sorted((ROOT / "msg").glob("*.msg"))

# Where the name of an import isn't that of the package on PyPI.
ON_PYPI = {"PIL": "pillow", "yaml": "PyYAML"}
# Where the key of rosdep isn't python3-<name>. None: there is no key; package.xml says so.
IN_ROSDEP = {
    "PIL": "python3-pil",
    "distributed": None,
    "laspy": None,
    "pypcd4": None,
    "rosbags": "python3-rosbags-pip",
    "small_gicp": None,
    "trimesh": "python3-trimesh-pip",
}
# Imported only where somebody has installed the extra.
OPTIONAL = {"distributed", "small_gicp"}
# Needed without an import: by the generated code of the messages.
WITHOUT_IMPORT = {"ros-jazzy-rosidl-default-runtime"}


@pytest.fixture(scope="module")
def description():
    """The arguments that setup.py calls setup() with."""
    arguments = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        patch.setattr(setuptools, "setup", arguments.update)
        runpy.run_path("setup.py")
    return arguments


@pytest.fixture(scope="module")
def manifest():
    return ElementTree.parse(ROOT / "package.xml").getroot()


def imports(paths):
    """The top-level names that the files import, but for Python's own and the package's."""
    found = set()
    for path in paths:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                found.add(node.module.split(".")[0])
    return found - set(sys.stdlib_module_names) - {"ellipseg_ros"}


def is_ros(name):
    return name == "rclpy" or name.endswith(("_msgs", "_srvs", "_interfaces"))


def bare(requirement):
    """The name in a requirement such as `setuptools>=70` or `rclpy[fastrtps]`."""
    return re.match(r"[\w.-]+", requirement).group()


def message_packages():
    """The packages of the types of the messages' fields."""
    texts = [path.read_text(encoding="utf-8") for path in MESSAGES]
    return {name for text in texts for name in re.findall(r"^(\w+)/\w+", text, re.MULTILINE)}


def on_pypi(name):
    return f"ros-jazzy-{name.replace('_', '-')}" if is_ros(name) else ON_PYPI.get(name, name)


def in_rosdep(name):
    if is_ros(name) or name.startswith("launch"):
        return name
    return IN_ROSDEP.get(name, f"python3-{name}")


def keys(manifest, *tags):
    return {element.text for tag in tags for element in manifest.iter(tag)}


def test_the_version_is_the_same_everywhere(description, manifest):
    changelog = (ROOT / "CHANGELOG.rst").read_text(encoding="utf-8")
    newest = re.search(r"^(\d+\.\d+\.\d+) \(.+\)\n-+$", changelog, re.MULTILINE).group(1)
    assert description["version"] == manifest.findtext("version") == newest


def test_name_maintainer_and_licence_are_the_same(description, manifest):
    assert description["name"] == manifest.findtext("name")
    assert description["maintainer"] == manifest.findtext("maintainer")
    assert description["maintainer_email"] == manifest.find("maintainer").get("email")
    assert description["license"] == manifest.findtext("license")
    assert (ROOT / manifest.find("license").get("file")).is_file()


def test_every_folder_with_code_is_installed(description):
    folders = {path.parent.relative_to(ROOT).as_posix().replace("/", ".") for path in SOURCES}
    assert set(description["packages"]) == folders


def test_every_config_launch_and_message_file_is_installed(description):
    installed = {source for _, sources in description["data_files"] for source in sources}
    folders = (ROOT / "config", ROOT / "launch")
    wanted = {
        str(path.relative_to(ROOT))
        for folder in folders
        for path in folder.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert wanted <= installed
    cmake = (ROOT / "CMakeLists.txt").read_text(encoding="utf-8")
    assert re.findall(r"msg/\w+\.msg", cmake) == [f"msg/{path.name}" for path in MESSAGES]


def test_every_script_names_a_function_that_is_there(description):
    for script in description["entry_points"]["console_scripts"]:
        name, module, function = re.fullmatch(r"(\w+) = ([\w.]+):(\w+)", script).groups()
        path = ROOT / (module.replace(".", "/") + ".py")
        tree = ast.parse(path.read_text(encoding="utf-8"))
        functions = [node.name for node in tree.body if isinstance(node, ast.FunctionDef)]
        assert function in functions, f"{name} calls {module}:{function}"


def test_pip_installs_what_the_code_imports_and_no_more(description):
    used = {on_pypi(name) for name in imports(SOURCES) | message_packages()}
    required = {bare(line) for line in description["install_requires"]}
    extras = description["extras_require"]
    optional = {bare(line) for name in ("bench", "dask") for line in extras[name]}
    assert used - optional == required - WITHOUT_IMPORT


def test_pip_installs_what_the_tests_import(description):
    used = {on_pypi(name) for name in imports(TESTS) - {path.stem for path in TESTS}}
    lines = description["install_requires"] + description["extras_require"]["test"]
    assert used - {"setuptools"} <= {bare(line) for line in lines}  # setuptools: pyproject.toml


def test_rosdep_installs_what_the_code_imports_and_no_more(manifest):
    names = imports(SOURCES + LAUNCH_FILES) | message_packages()
    unimported = {"rosidl_default_runtime", "rviz2"}  # for C++; run by a launch file
    required = keys(manifest, "exec_depend", "depend") - unimported
    assert {in_rosdep(name) for name in names} - {None} == required
    remark = (ROOT / "package.xml").read_text(encoding="utf-8")
    without_key = {name for name in names - OPTIONAL if in_rosdep(name) is None}
    assert all(name in remark for name in without_key)


def test_the_packages_of_the_messages_are_there_to_build_with(manifest):
    wanted = message_packages()
    assert wanted <= keys(manifest, "depend")
    cmake = (ROOT / "CMakeLists.txt").read_text(encoding="utf-8")
    found = set(re.findall(r"find_package\((\w+) REQUIRED\)", cmake))
    assert wanted <= found
    assert set(re.search(r"DEPENDENCIES ([\w ]+)", cmake).group(1).split()) == wanted
    pyproject = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    for name in found:
        assert f'"ros-jazzy-{name.replace("_", "-")}"' in pyproject


@pytest.mark.parametrize("path", MESSAGES, ids=lambda path: path.name)
def test_every_field_of_a_message_has_a_comment_above_it(path):
    lines = path.read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("# ")
    for above, line in zip(["", *lines], lines, strict=False):
        if line and not line.startswith("#"):
            assert above.startswith("# "), f"{path.name}: {line}"
            assert "#" not in line, f"{path.name}: {line}: `ros2 interface show` mangles it"


def test_no_check_is_switched_off_without_a_reason_beside_it():
    mark = re.compile(r"#\s*(noqa|type:\s*ignore|pragma)")
    reasoned = re.compile(r"# (noqa: [A-Z]+\d+(, [A-Z]+\d+)*|type: ignore\[[\w, -]+\])\W+\w.{7,}")
    for path in [ROOT / "setup.py", *SOURCES, *LAUNCH_FILES, *TESTS]:
        with path.open(encoding="utf-8") as file:
            for token in tokenize.generate_tokens(file.readline):
                if token.type == tokenize.COMMENT and mark.search(token.string):
                    where = f"{path.relative_to(ROOT)}:{token.start[0]}: {token.string}"
                    assert reasoned.search(token.string), where
