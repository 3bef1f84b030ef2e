"""Nothing that the package reads can run code, and no flood of messages floods the log."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("ellipseg_ros", "examples", "studies", "launch")
SOURCES = sorted(
    path
    for folder in FOLDERS
    for path in (ROOT / folder).rglob("*.py")
    if path.parent != ROOT / "ellipseg_ros" / "msg"  # generated
)
NODES = sorted((ROOT / "ellipseg_ros" / "ros").glob("*.py"))

# What runs code that stands in data.
FORBIDDEN_MODULES = {"cPickle", "cloudpickle", "dill", "jsonpickle", "marshal", "pickle", "shelve"}
# numba's own format: compiled code, in a folder of the user alone; whoever writes there could
# change the code itself.
ITS_OWN = {"core/kernel_cache.py": {"pickle"}}
FORBIDDEN_CALLS = {
    "compile",
    "eval",
    "exec",
    "os.popen",
    "os.system",
    "yaml.full_load",
    "yaml.load",
    "yaml.load_all",
    "yaml.unsafe_load",
}
# Lines of the log that need no throttle: at most one in a run, for each place.
ONCE = {
    ("parameters.py", "_initial_values"),  # at the start
    ("associator_node.py", "_start"),  # when it is ready
    ("segmenter_node.py", "_subscribe"),  # likewise
    ("segmenter_node.py", "_check_frame"),  # ten frames
    ("worker.py", "run"),  # at the start
    ("worker.py", "_update"),  # a quota
    ("live_tuning.py", "_apply"),  # tunings are limited
    ("replayer.py", "_play"),  # at the end
    ("process.py", "_report"),  # at the end
}


def calls(tree: ast.AST) -> Iterator[tuple[str, ast.Call]]:
    """Yield every call, with the dotted name of what is called."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func), node


def keyword(call: ast.Call, name: str) -> object:
    """The constant given for a keyword; None if there is none."""
    for item in call.keywords:
        if item.arg == name and isinstance(item.value, ast.Constant):
            return item.value.value
    return None


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_data_is_run_as_code(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        names = [item.name for item in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom):
            names.append(node.module or "")
        found = {name.split(".")[0] for name in names} & FORBIDDEN_MODULES
        assert found <= ITS_OWN.get("/".join(path.parts[-2:]), set())
    for name, call in calls(tree):
        assert name not in FORBIDDEN_CALLS, f"line {call.lineno}: {name}"
        assert keyword(call, "shell") is not True, f"line {call.lineno}: a shell"
        if name.endswith(("np.load", "numpy.load")):
            assert keyword(call, "allow_pickle") is False, f"line {call.lineno}: np.load"
        assert keyword(call, "allow_pickle") is not True


def test_the_search_finds_what_it_looks_for() -> None:
    tree = ast.parse("np.load(path); yaml.load(text); run(x, shell=True); np.load(p, None, True)")
    found = dict(calls(tree))
    assert {"np.load", "yaml.load", "run"} == found.keys()
    assert keyword(found["run"], "shell") is True
    assert keyword(found["np.load"], "allow_pickle") is None
    read = [name for path in SOURCES for name, _ in calls(ast.parse(path.read_text()))]
    assert read.count("np.load") >= 2 and read.count("yaml.safe_load") >= 1


def log_lines(path: Path) -> Iterator[tuple[str, ast.Call]]:
    """Yield every line that a file logs, with the function that it is in."""
    for function in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(function, ast.FunctionDef):
            for name, call in calls(function):
                speaker, _, level = name.rpartition(".")
                if level in {"info", "warning", "warn", "error", "fatal"} and "log" in speaker:
                    yield function.name, call


def is_throttled(call: ast.Call) -> bool:
    """Whether a line is given `**throttled(...)`; test_limits forbids any other way."""
    return any(
        item.arg is None and ast.unparse(item.value).startswith("throttled(")
        for item in call.keywords
    )


@pytest.mark.parametrize("path", NODES, ids=lambda path: path.name)
def test_every_line_of_the_log_is_throttled_or_rare(path: Path) -> None:
    for function, call in log_lines(path):
        assert is_throttled(call) or (path.name, function) in ONCE, f"line {call.lineno}"


def test_the_rare_lines_are_there() -> None:
    found = {(path.name, function) for path in NODES for function, _ in log_lines(path)}
    assert found >= ONCE
