"""README.md, CONTRIBUTING.md and docs/ agree with the code."""

import ast
import importlib.util
import shlex
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from sources import ROOT, parse

from ellipseg_ros.cli.parser import build_parser
from ellipseg_ros.config import AssociationConfig, Config, MapConfig, NodeConfig, PlacementConfig
from ellipseg_ros.io.topics import ASSOCIATOR, CLOCK, REPLAYER, SEGMENTER, SERVICES, TOPICS
from ellipseg_ros.settings import iterate_settings

README = ROOT / "README.md"
DOCS = ROOT / "docs"
PAGES = [README, ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]
WRITTEN_BY_US = [page for page in PAGES if page.parent != DOCS / "results"]
NODES_PAGE = DOCS / "reference" / "nodes.md"
MAX_README_LINES = 180
MAX_PICTURE_BYTES = 500_000


@pytest.fixture(scope="module")
def reference() -> Iterator[ModuleType]:
    """The script that writes pages of docs/reference."""
    path = DOCS / "_tools" / "reference.py"
    spec = importlib.util.spec_from_file_location("reference", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["reference"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["reference"]


def tokens(page: Path) -> list[Any]:
    """The Markdown tokens of a page; inline ones follow their block."""
    from markdown_it import MarkdownIt

    blocks = MarkdownIt("commonmark").enable("table").parse(page.read_text(encoding="utf-8"))
    return [token for block in blocks for token in (block, *(block.children or ()))]


def code_blocks(page: Path, language: str) -> list[str]:
    """The fenced code of a page in one language."""
    return [t.content for t in tokens(page) if t.type == "fence" and t.info.strip() == language]


def shell_lines(program: str) -> list[list[str]]:
    """The words of every command line in our pages that starts with `program`."""
    lines = [
        line
        for page in WRITTEN_BY_US
        for block in code_blocks(page, "bash")
        for line in block.splitlines()
    ]
    words = [shlex.split(line, comments=True) for line in lines if line.startswith(program)]
    return [line for line in words if line[: len(program.split())] == program.split()]


def inline_code(page: Path) -> set[str]:
    """The texts in backticks of a page."""
    return {token.content for token in tokens(page) if token.type == "code_inline"}


def test_readme_is_short() -> None:
    assert len(README.read_text(encoding="utf-8").splitlines()) <= MAX_README_LINES


def test_results_of_the_readme_are_on_the_linked_pages() -> None:
    section = README.read_text(encoding="utf-8").partition("## Results\n")[2].partition("\n## ")[0]
    rows = [line.split(" | ") for line in section.splitlines() if "](docs/results/" in line]
    assert len(rows) >= 5
    for _, result, link, *_ in rows:
        page = ROOT / link.partition("](")[2].partition(")")[0]
        on_page = set(page.read_text(encoding="utf-8").replace("|", " ").split())
        numbers = {word.rstrip(",") for word in result.split() if word[0].isdigit()}
        assert numbers - {"10-NN"} <= on_page, f"{result}: see {page.name}"


def test_generated_reference_pages_are_up_to_date(reference: ModuleType) -> None:
    for name in reference.PAGES:
        text = (DOCS / "reference" / name).read_text(encoding="utf-8")
        assert text == reference.page(name), f"{name} is outdated; run `make docs`"


def test_diagnostics_table_lists_the_messages_of_the_node() -> None:
    rows = NODES_PAGE.read_text(encoding="utf-8").splitlines()
    documented = {
        row.split("`")[1] for row in rows if row.startswith(("| ERROR |", "| WARN |", "| OK |"))
    }
    texts = diagnostic_texts(ROOT / "ellipseg_ros" / "node" / "health.py")
    assert len(texts) >= 12
    for text in texts:
        assert any(matches(text, phrase) for phrase in documented), f"not documented: {text}"
    for phrase in documented:
        assert any(matches(text, phrase) for text in texts), f"the node never reports {phrase}"


def test_topics_and_services_of_the_nodes_are_documented() -> None:
    text = NODES_PAGE.read_text(encoding="utf-8")
    for node, title in (
        (SEGMENTER, "Segmenter"),
        (ASSOCIATOR, "Associator"),
        (REPLAYER, "Replayer"),
    ):
        section = text.partition(f"\n## {title}\n")[2].partition("\n## ")[0]
        rows = [line for line in section.splitlines() if line.startswith("| `")]
        for topic in TOPICS:
            if node in topic.publishers:
                assert f"| `{topic.name}` | `{short(topic.type)}` |" in "\n".join(rows), topic
            elif node in topic.subscribers and topic != CLOCK:  # use_sim_time, as in any node
                assert f"| `{topic.name}` (in) | `{short(topic.type)}` |" in "\n".join(rows), topic
        for service in SERVICES:
            if service.node == node:
                assert f"| `{service.name}` | `{short(service.type)}` |" in "\n".join(rows), (
                    service
                )


def short(name: str) -> str:
    """The name of a type as the command line tools of ROS abbreviate it."""
    return name.replace("/msg/", "/").replace("/srv/", "/")


def matches(text: str, phrase: str) -> bool:
    """Whether a phrase is part of a text of the node, in which {} stands for any word."""
    words = [part.strip() for part in text.split("{}") if part.strip()]
    return phrase in text or all(word in phrase for word in words)


def diagnostic_texts(path: Path) -> list[str]:
    """The texts that a module returns beside a level, or in a table of warnings."""
    texts = []
    for node in ast.walk(parse(path)):
        values: list[ast.expr] = []
        if isinstance(node, ast.Return) and isinstance(node.value, ast.Tuple | ast.List):
            rows = node.value.elts
            values = [row.elts[0] if isinstance(row, ast.Tuple) else row for row in rows]
        elif isinstance(node, ast.Return) and isinstance(node.value, ast.IfExp):
            values = [
                element
                for branch in (node.value.body, node.value.orelse)
                if isinstance(branch, ast.Tuple)
                for element in branch.elts
            ]
        for value in values:
            text = "".join(part for part in constants(value))
            if " " in text or text == "segmenting":
                texts.append(text)
    return texts


def constants(value: ast.expr) -> Iterator[str]:
    """Yield the constant parts of a string or f-string, with {} for what is computed."""
    if isinstance(value, ast.Constant) and isinstance(value.value, str):
        yield value.value
    elif isinstance(value, ast.JoinedStr):
        for part in value.values:
            yield str(part.value) if isinstance(part, ast.Constant) else "{}"


def test_python_of_the_readme_runs(capsys: pytest.CaptureFixture[str]) -> None:
    examples = code_blocks(README, "python")
    assert examples
    for example in examples:
        exec(compile(example, "README.md", "exec"), {})
    assert "Counts(segmented=5000" in capsys.readouterr().out


def test_python_of_the_guides_runs() -> None:
    examples = [block for page in sorted((DOCS / "guide").glob("*.md"))
                for block in code_blocks(page, "python")]  # fmt: skip
    assert examples
    for example in examples:
        exec(compile(example, "guide", "exec"), {})


def test_commands_in_the_pages_parse() -> None:
    lines = shell_lines("ellipseg")
    assert len(lines) >= 10
    for line in lines:
        assert build_parser().parse_args(line[1:]).command == line[1]


def test_studies_in_the_pages_exist() -> None:
    lines = shell_lines("python -m")
    assert lines
    for line in lines:
        module = line[2].partition(".NAME")[0]
        assert importlib.util.find_spec(module) is not None, line


def test_make_targets_in_the_pages_exist() -> None:
    used = {line[1] for line in shell_lines("make")} - {"help"}
    assert used >= {"demo", "test", "docs", "coverage"}
    result = subprocess.run(["make", "help"], cwd=ROOT, capture_output=True, text=True, check=True)
    offered = {line.split()[1] for line in result.stdout.splitlines() if line.startswith("make ")}
    assert used <= offered


def test_local_links_lead_to_files() -> None:
    for page in PAGES:
        for token in tokens(page):
            target = token.attrs.get("href") or token.attrs.get("src") or ""
            path = str(target).partition("#")[0]
            if path and "://" not in path and not path.startswith("mailto:"):
                assert (page.parent / path).exists(), f"{page.relative_to(ROOT)}: {target}"


def test_documentation_site_builds_without_warnings(tmp_path: Path) -> None:
    pytest.importorskip("myst_parser", reason="no Sphinx; pip install 'ellipseg_ros[docs]'")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "dummy"]
    result = subprocess.run(
        [*command, str(DOCS), str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr


def test_pictures_are_small_and_used() -> None:
    used = {
        (page.parent / str(token.attrs["src"])).resolve()
        for page in PAGES
        for token in tokens(page)
        if token.type == "image" and "://" not in str(token.attrs["src"])
    }
    for picture in (DOCS / "images").iterdir():
        assert picture.stat().st_size < MAX_PICTURE_BYTES
        assert picture.resolve() in used, picture.name


def test_launch_files_and_executables_in_the_pages_exist() -> None:
    setup = (ROOT / "setup.py").read_text(encoding="utf-8")
    launched, run = shell_lines("ros2 launch ellipseg_ros"), shell_lines("ros2 run ellipseg_ros")
    assert launched and run
    assert all((ROOT / "launch" / line[3]).exists() for line in launched)
    assert all(f'"{line[3]}": "ellipseg_ros.ros.' in setup for line in run)


def test_method_page_names_existing_code() -> None:
    modules = ("core.", "config.", "node.", "objects.", "landmarks.", "segmenter.", "io.")
    names = {
        name.rstrip("()")
        for name in inline_code(DOCS / "explanation" / "method.md")
        if name.startswith(modules) and not name.endswith((".py", "/", "yaml"))
    }
    assert len(names) >= 12
    for name in names:
        module, _, attribute = name.rpartition(".")
        assert hasattr(import_module(f"ellipseg_ros.{module}"), attribute), name


def test_files_named_in_the_architecture_page_exist() -> None:
    page = DOCS / "explanation" / "architecture.md"
    named = {text for text in inline_code(page) if text.endswith((".py", ".msg", "/"))}
    assert len(named) >= 20
    places = (ROOT, ROOT / "ellipseg_ros")
    missing = {text for text in named if not any((place / text).exists() for place in places)}
    assert not missing


def test_settings_named_in_the_pages_exist() -> None:
    configs = (Config(), NodeConfig(), PlacementConfig(), AssociationConfig(), MapConfig())
    known = {name for config in configs for name, _, _ in iterate_settings(config)}
    prefixes = ("graph.", "model.", "objects.s", "objects.t", "max_", "marker_")
    for page in WRITTEN_BY_US:
        named = {text.partition(":")[0] for text in inline_code(page) if text.startswith(prefixes)}
        assert {name for name in named if " " not in name} <= known, page
