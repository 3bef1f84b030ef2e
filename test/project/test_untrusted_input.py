"""No data that the package reads can run code, and no flood of messages floods the log."""

import ast
from collections.abc import Iterator
from pathlib import Path

from sources import PACKAGE, ROOT, imported_modules, parse, python_files

SOURCES = [
    path
    for folder in ("ellipseg_ros", "examples", "studies", "launch")
    for path in python_files(folder)
]
NODES = python_files("ellipseg_ros/ros")

# Modules and calls that run code contained in data.
FORBIDDEN_MODULES = {"cPickle", "cloudpickle", "dill", "jsonpickle", "marshal", "pickle", "shelve"}
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
# numba's own format: compiled code in a folder that only the user can write to.
ALLOWED_MODULES = {PACKAGE / "core" / "kernel_cache.py": {"pickle"}}
LOG_LEVELS = {"info", "warning", "warn", "error", "fatal"}
# Unthrottled log lines, as (file, function), with the reason why they are rare.
RARE = {
    ("associator_node.py", "_start"): "once, when ready",
    ("live_tuning.py", "_apply"): "once per tuning, which are limited",
    ("parameters.py", "_initial_values"): "once, at the start",
    ("process.py", "_report"): "once, at the end",
    ("replayer.py", "_play"): "once, at the end",
    ("segmenter_node.py", "_work"): "twice, at the start",
    ("worker.py", "_update"): "has a quota",
}


def calls(tree: ast.AST) -> Iterator[tuple[str, ast.Call]]:
    """Yield every call with the dotted name of the called function."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func), node


def keyword(call: ast.Call, name: str) -> object:
    """The constant value of a keyword argument; None if it is not given."""
    for item in call.keywords:
        if item.arg == name and isinstance(item.value, ast.Constant):
            return item.value.value
    return None


def runs_data(name: str, call: ast.Call) -> bool:
    """Whether a call can run code contained in its arguments."""
    loads = name.endswith(("np.load", "numpy.load"))
    return (
        name in FORBIDDEN_CALLS
        or keyword(call, "shell") is True
        or keyword(call, "allow_pickle") is True
        or (loads and keyword(call, "allow_pickle") is not False)
    )


def log_calls(path: Path) -> Iterator[tuple[str, ast.Call]]:
    """Yield (function, call) for every line that a file logs."""
    for function in ast.walk(parse(path)):
        if isinstance(function, ast.FunctionDef):
            for name, call in calls(function):
                logger, _, level = name.rpartition(".")
                if level in LOG_LEVELS and "log" in logger:
                    yield function.name, call


def is_throttled(call: ast.Call) -> bool:
    """Whether a log call has the argument `**throttled(...)`."""
    return any(
        item.arg is None and ast.unparse(item.value).startswith("throttled(")
        for item in call.keywords
    )


def test_no_module_that_runs_data_is_imported() -> None:
    for path in SOURCES:
        tops = {name.partition(".")[0] for name in imported_modules(path)}
        assert tops & FORBIDDEN_MODULES <= ALLOWED_MODULES.get(path, set()), path


def test_no_call_runs_data() -> None:
    found = [
        f"{path.relative_to(ROOT)}:{call.lineno}: {name}"
        for path in SOURCES
        for name, call in calls(parse(path))
        if runs_data(name, call)
    ]
    assert not found


def test_calls_that_run_data_are_recognized() -> None:
    text = "np.load(p); yaml.load(t); run(x, shell=True); np.load(p, None, True); eval(t)"
    assert all(runs_data(name, call) for name, call in calls(ast.parse(text)))
    text = "np.load(p, allow_pickle=False); yaml.safe_load(t); run(x)"
    assert not any(runs_data(name, call) for name, call in calls(ast.parse(text)))
    names = [name for path in SOURCES for name, _ in calls(parse(path))]
    assert "np.load" in names and "yaml.safe_load" in names


def test_log_lines_of_nodes_are_throttled_or_rare() -> None:
    unthrottled = {
        (path.name, function)
        for path in NODES
        for function, call in log_calls(path)
        if not is_throttled(call)
    }
    assert unthrottled == set(RARE)
