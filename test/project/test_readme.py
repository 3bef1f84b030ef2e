"""What README.md and docs/ say is so."""

import re
import shlex
from importlib import import_module
from pathlib import Path

import pytest

from ellipseg_ros.cli.parser import build_parser
from ellipseg_ros.config import (
    AssociationConfig,
    AssociatorConfig,
    Checked,
    Config,
    MapConfig,
    NodeConfig,
    walk,
)
from ellipseg_ros.node.playback import ReplayOptions
from ellipseg_ros.ros.replayer import Place

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
DOCS = sorted((ROOT / "docs").rglob("*.md"))
PAGES = [ROOT / "README.md", *DOCS]


def parameter_table(*records: Checked) -> str:
    """A table of the README."""
    rows = ["| parameter | type | default | unit | range | what |", "| --- " * 6 + "|"]
    for config in records:
        for name, value, about in walk(config):
            limits = ", ".join(about.choices)
            if about.low is not None:
                limits = f"{about.low:g} ... {about.high:g}" if about.high else f">= {about.low:g}"
            kind = {float: "double", int: "int", str: "string", bool: "bool"}[type(value)]
            mark = "" if about.live else " *"
            shown = str(value).lower() if isinstance(value, bool) else value
            rows.append(
                f"| `{name}`{mark} | {kind} | {shown} | {about.unit} | {limits} | {about.about} |"
            )
    return "\n".join(rows)


def blocks(page: Path, language: str) -> list[str]:
    """The fenced code of a page."""
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)


def command_lines() -> list[list[str]]:
    """Every `ellipseg ...` of every page, as words."""
    lines = "\n".join(block for page in PAGES for block in blocks(page, "bash")).splitlines()
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("ellipseg ")]


def test_the_parameters_are_those_of_config() -> None:
    shown = README.split("compares this table with config.py -->\n")[1]
    assert shown.split("\n<!-- end of parameters -->")[0] == parameter_table(
        Config(), NodeConfig()
    )


def test_the_parameters_of_the_associator_are_those_of_config() -> None:
    shown = README.split("compares this one, too -->\n")[1].split("\n<!-- end")[0]
    assert shown == parameter_table(AssociationConfig(), MapConfig(), AssociatorConfig())


def test_the_parameters_of_the_replayer_are_those_of_its_options() -> None:
    shown = README.split("compares this one as well -->\n")[1].split("\n<!-- end")[0]
    assert shown == parameter_table(ReplayOptions(), Place())


def test_the_levels_of_the_diagnostics_are_those_of_the_node() -> None:
    source = (ROOT / "ellipseg_ros" / "ros" / "health.py").read_text()
    table = README.split("with ros/health.py -->\n")[1].split("\n<!-- end")[0]
    named = re.findall(r"^\| \w+ \| [^`]*`([^`]+)`", table, re.M)
    # Where a line begins; one that begins with a number goes on with the next word.
    begun = re.findall(r'(?:append\(|return \[|ERROR, |OK, )\s*f?"(?:{[^}]*} )?([^"{]+)', source)
    said = {line.strip() for line in begun}
    assert len(said) >= 12
    for line in said:
        assert any(line in name or name in line for name in named), f"{line} is not in README.md"
    for name in named:
        assert any(line in name or name in line for line in said), f"{name} is never said"


def test_the_python_runs(capsys: pytest.CaptureFixture[str]) -> None:
    examples = blocks(ROOT / "README.md", "python")
    assert examples
    for example in examples:
        exec(compile(example, "README.md", "exec"), {})
    assert "Counts(segmented=5000" in capsys.readouterr().out


@pytest.mark.parametrize("words", command_lines(), ids=" ".join)
def test_the_commands_parse(words: list[str]) -> None:
    args = build_parser().parse_args(words)
    assert args.command == words[0]


def test_the_make_targets_exist() -> None:
    makefile = (ROOT / "Makefile").read_text()
    targets = {
        word
        for text in map(Path.read_text, PAGES)
        for word in re.findall(r"^make (\w+)", text, re.M)
    }
    assert targets >= {"demo", "test"}
    assert all(re.search(rf"^{target}:", makefile, re.M) for target in targets)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_links_lead_somewhere(page: Path) -> None:
    links = re.findall(r"\]\((?!https?://)([^)#]+)", page.read_text())
    missing = [link for link in links if not (page.parent / link).exists()]
    assert not missing


def test_the_pictures_are_small_and_used() -> None:
    text = "".join(page.read_text() for page in PAGES)
    for picture in (ROOT / "docs" / "images").iterdir():
        assert picture.stat().st_size < 500_000
        assert f"images/{picture.name})" in text


def test_the_launch_files_and_executables_exist() -> None:
    setup = (ROOT / "setup.py").read_text()
    for page in PAGES:
        for name in re.findall(r"ros2 launch ellipseg_ros (\S+)", page.read_text()):
            assert (ROOT / "launch" / name).exists()
        for name in re.findall(r"ros2 run ellipseg_ros (\S+)", page.read_text()):
            assert f'"{name}": "ellipseg_ros.ros.' in setup


def test_the_paper_page_names_code_that_exists() -> None:
    text = (ROOT / "docs" / "explanation" / "method.md").read_text()
    names = set(re.findall(r"`((?:core|config|colours|grouping|segmenter)\.[\w.]+)`", text))
    assert len(names) >= 12
    for name in names:
        module, _, attribute = name.rpartition(".")
        assert hasattr(import_module(f"ellipseg_ros.{module}"), attribute), name


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_named_settings_exist(page: Path) -> None:
    configs = (Config(), NodeConfig(), AssociationConfig(), MapConfig())
    known = {name for config in configs for name, _, _ in walk(config)}
    named = re.findall(r"`((?:graph|model|max|marker)[._]\w+)(?::[^`]*)?`", page.read_text())
    assert set(named) <= known
