"""setup.py, package.xml, pyproject.toml and CMakeLists.txt agree with each other and the code."""

import importlib
import runpy
import sys
import tokenize
from importlib.metadata import EntryPoint
from typing import Any
from xml.etree import ElementTree

import pytest
import setuptools
from docutils import nodes
from docutils.core import publish_doctree
from packaging.requirements import Requirement
from rosbags.typesys import get_types_from_msg
from setuptools.config.pyprojecttoml import load_file
from sources import ROOT, is_ros, python_files, third_party

SOURCES = python_files("ellipseg_ros")
LAUNCH_FILES = python_files("launch")
TESTS = python_files("test")
MESSAGES = sorted((ROOT / "msg").glob("*.msg"))

# PyPI names that differ from the imported name.
ON_PYPI = {
    "PIL": "pillow",
    "kiss_icp": "kiss-icp",
    "markdown_it": "markdown-it-py",
    "yaml": "PyYAML",
}
# rosdep keys that are not python3-<imported name>. All keys were found in rosdep's python.yaml.
IN_ROSDEP = {
    "PIL": "python3-pil",
    "rosbags": "python3-rosbags-pip",
    "trimesh": "python3-trimesh-pip",
}
EXTRAS = {"files", "plots", "page", "peers", "dask", "odometry", "slam", "docs", "test"}
# Imported only by commands and formats that need an extra.
OPTIONAL = {"PIL", "distributed", "kiss_icp", "laspy", "matplotlib", "pypcd4", "trimesh"}
# Needed by the generated code of the messages, without an import of ours.
WITHOUT_IMPORT = {"ros-jazzy-rosidl-default-runtime"}


@pytest.fixture(scope="module")
def description() -> dict[str, Any]:
    """The arguments that setup.py calls setup() with."""
    arguments: dict[str, Any] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        patch.setattr(setuptools, "setup", arguments.update)
        runpy.run_path("setup.py")
    return arguments


@pytest.fixture(scope="module")
def manifest() -> ElementTree.Element:
    """The root element of package.xml."""
    return ElementTree.parse(ROOT / "package.xml").getroot()


@pytest.fixture(scope="module")
def build_requirements() -> set[str]:
    """Names of the packages in pyproject.toml that the build needs."""
    return names_of(load_file(ROOT / "pyproject.toml")["build-system"]["requires"])


def names_of(requirements: list[str]) -> set[str]:
    """Package names without versions and extras."""
    return {Requirement(line).name for line in requirements}


def message_packages() -> set[str]:
    """The packages of the types of the messages' fields."""
    packages = set()
    for path in MESSAGES:
        name = f"ellipseg_ros/msg/{path.stem}"
        _, fields = get_types_from_msg(path.read_text(encoding="utf-8"), name)[name]
        packages |= {package for _, field in fields for package in packages_in(field)}
    return packages - {"ellipseg_ros"}


def packages_in(field: Any) -> set[str]:
    """The packages named in a rosbags field description: nested (kind, details) tuples."""
    if isinstance(field, str):
        package, separator, _ = field.partition("/msg/")
        return {package} if separator else set()
    if isinstance(field, tuple):
        return {package for part in field for package in packages_in(part)}
    return set()


def on_pypi(name: str) -> str:
    """PyPI name of an imported package."""
    return f"ros-jazzy-{name.replace('_', '-')}" if is_ros(name) else ON_PYPI.get(name, name)


def in_rosdep(name: str) -> str:
    """Key in rosdep of an imported package."""
    if is_ros(name) or name.startswith("launch"):
        return name
    return IN_ROSDEP.get(name, f"python3-{name}")


def keys(manifest: ElementTree.Element, *tags: str) -> set[str]:
    """The texts of all elements with one of the tags."""
    return {element.text or "" for tag in tags for element in manifest.iter(tag)}


def test_the_version_is_read_from_the_manifest(description, manifest):
    assert description["version"] == manifest.findtext("version")
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8").splitlines()
    assert f"version: {manifest.findtext('version')}" in citation


def test_the_changelog_has_the_catkin_form_and_is_grouped_by_kind(manifest):
    text = (ROOT / "CHANGELOG.rst").read_text(encoding="utf-8")
    document = publish_doctree(text, settings_overrides={"doctitle_xform": False})
    heading, *sections = document.findall(nodes.section)
    assert heading.next_node(nodes.title).astext() == "Changelog for package ellipseg_ros"
    titles = [section.next_node(nodes.title).astext() for section in sections]
    assert titles[0] == "Forthcoming" or titles[0].split()[0] == manifest.findtext("version")
    for section in sections:
        kinds = section.next_node(nodes.bullet_list).children
        names = [kind.next_node(nodes.paragraph).astext() for kind in kinds]
        assert names and set(names) <= {"Added", "Changed", "Fixed", "Removed"}
        assert all(kind.next_node(nodes.bullet_list) for kind in kinds)


def test_name_maintainer_and_licence_are_the_same(description, manifest):
    assert description["name"] == manifest.findtext("name")
    assert description["maintainer"] == manifest.findtext("maintainer")
    assert description["maintainer_email"] == manifest.find("maintainer").get("email")
    assert description["license"] == manifest.findtext("license")
    assert (ROOT / manifest.find("license").get("file")).is_file()


def test_every_folder_with_code_is_installed_and_no_study(description):
    folders = {path.parent.relative_to(ROOT).as_posix().replace("/", ".") for path in SOURCES}
    assert set(description["packages"]) == folders


def test_every_config_launch_and_message_file_is_installed(description):
    installed = {source for _, sources in description["data_files"] for source in sources}
    files = {
        path.relative_to(ROOT).as_posix()
        for folder in ("config", "launch")
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and not {"__pycache__", "_tools"} & set(path.parts)
    }
    assert files <= installed
    words = (ROOT / "CMakeLists.txt").read_text(encoding="utf-8").split()
    assert [w for w in words if w.startswith("msg/")] == [f"msg/{path.name}" for path in MESSAGES]


def test_every_script_calls_an_existing_function(description):
    for script in description["entry_points"]["console_scripts"]:
        name, _, value = script.partition(" = ")
        assert callable(EntryPoint(name, value, "console_scripts").load()), script


def test_pip_installs_what_the_package_imports_and_no_more(description):
    used = {on_pypi(name) for name in (third_party(SOURCES) | message_packages()) - OPTIONAL}
    assert used == names_of(description["install_requires"]) - WITHOUT_IMPORT


def test_the_extras_install_the_optional_imports(description):
    extras = description["extras_require"]
    assert set(extras) == EXTRAS
    used = ("files", "plots", "dask", "odometry")
    offered = names_of([line for extra in used for line in extras[extra]])
    assert {on_pypi(name) for name in OPTIONAL} == offered
    assert offered <= names_of(extras["test"])  # `make setup` suffices for tests and demo


def test_pip_installs_what_the_tests_import(description, build_requirements):
    own = {path.stem for path in TESTS} | {"docutils", "gtsam", "packaging"}
    used = {on_pypi(name) for name in third_party(TESTS) - own}
    lines = description["install_requires"] + description["extras_require"]["test"]
    assert used <= names_of(lines) | build_requirements


def test_rosdep_installs_what_the_package_imports_and_no_more(manifest):
    names = (third_party(SOURCES + LAUNCH_FILES) | message_packages()) - OPTIONAL
    # For C++; run by a launch file; imported by name, where it is installed.
    without_import = {"rosidl_default_runtime", "rviz2", "tf2_msgs"}
    required = keys(manifest, "exec_depend", "depend") - without_import
    assert {in_rosdep(name) for name in names} == required


def test_the_packages_of_the_messages_are_there_to_build_with(manifest, build_requirements):
    packages = message_packages()
    assert packages <= keys(manifest, "depend")
    cmake = (ROOT / "CMakeLists.txt").read_text(encoding="utf-8")
    for name in packages | {"ament_cmake", "rosidl_default_generators"}:
        assert f"find_package({name} REQUIRED)" in cmake
        assert f"ros-jazzy-{name.replace('_', '-')}" in build_requirements
    assert f"DEPENDENCIES {' '.join(sorted(packages))}" in cmake


def test_every_field_of_a_message_has_a_comment_above_it():
    for path in MESSAGES:
        lines = path.read_text(encoding="utf-8").splitlines()
        assert lines[0].startswith("# ")
        for above, line in zip(["", *lines], lines, strict=False):
            if line and not line.startswith("#"):
                assert above.startswith("# "), f"{path.name}: {line}"
                # `ros2 interface show` mangles comments behind a field.
                assert "#" not in line, f"{path.name}: {line}"


def test_every_disabled_check_has_a_reason_beside_it():
    for path in [ROOT / "setup.py", *SOURCES, *LAUNCH_FILES, *python_files("studies"), *TESTS]:
        with path.open(encoding="utf-8") as file:
            for token in tokenize.generate_tokens(file.readline):
                if token.type == tokenize.COMMENT and disables_a_check(token.string):
                    where = f"{path.relative_to(ROOT)}:{token.start[0]}: {token.string}"
                    assert has_rule_and_reason(token.string), where


def disables_a_check(comment: str) -> bool:
    """Whether a comment switches off a check of ruff, mypy or coverage."""
    words = comment.lstrip("# ")
    return words.startswith(("noqa", "type: ignore", "pragma"))


def has_rule_and_reason(comment: str) -> bool:
    """Whether a comment such as `# noqa: N806, a customary name` names a rule and a reason."""
    if "ignore[" in comment:
        reason = comment.partition("]")[2]
    else:
        _, colon, rest = comment.lstrip("# ").partition(": ")
        rule, *words = rest.split()
        if not colon or not rule[0].isupper():
            return False
        reason = " ".join(word for word in words if not word.rstrip(",")[-1].isdigit())
    return len(reason.strip("#, ")) > 7


def test_comments_that_disable_checks_are_recognized():
    assert disables_a_check("# noqa: F401") and disables_a_check("#type: ignore[misc]")
    assert not disables_a_check("# the noqa of the line above")
    assert has_rule_and_reason("# noqa: N806  # customary name")
    assert has_rule_and_reason("# noqa: N806, a customary name")
    assert has_rule_and_reason("# type: ignore[misc]  # untyped decorator")
    for without in ("# noqa: N806", "# noqa: N806, N802", "# noqa: customary name"):
        assert not has_rule_and_reason(without)
    assert not has_rule_and_reason("# type: ignore[misc]")


def test_setup_py_needs_nothing_but_setuptools():
    assert third_party([ROOT / "setup.py"]) <= {"ament_package", "setuptools"}
    assert importlib.util.find_spec("setuptools") and sys.version_info >= (3, 10)
