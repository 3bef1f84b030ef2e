"""Compiling: all at the start, and wherever the package is installed."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from clouds import stream
from numba.core.dispatcher import Dispatcher

import ellipseg_ros.core
from ellipseg_ros.config import Config
from ellipseg_ros.core.criteria import CRITERIA
from ellipseg_ros.node.grouping import updates
from ellipseg_ros.records import Sweep
from ellipseg_ros.segmenter import Segmenter, segment, warm_up
from ellipseg_ros.tuning.search import Search, tune

PACKAGE = Path(ellipseg_ros.core.__file__).parents[1]


def compiled():
    """The number of compiled or loaded versions of every kernel."""
    modules = [m for name, m in sys.modules.items() if name.startswith("ellipseg_ros.")]
    kernels = [
        value for m in modules for value in vars(m).values() if isinstance(value, Dispatcher)
    ]
    return {kernel.py_func.__qualname__: len(kernel.signatures) for kernel in kernels}


def test_nothing_is_compiled_after_the_warm_up():
    code = "import test_jit; test_jit.warm_then_work()"
    paths = [str(Path(__file__).parent), str(Path(__file__).parents[1])]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    subprocess.run([sys.executable, "-c", code], check=True, env=env)


def warm_then_work():
    warm_up()
    before = compiled()
    assert len(before) > 20
    for criterion in CRITERIA:
        config = Config(criterion=criterion, window_duration=1.0, update_period=0.3)
        segmenter = Segmenter(config)
        for group in updates(stream(np.random.default_rng(0), sweeps=60), config):
            segmenter.process(group)
        tune(np.random.default_rng(2).random((500, 3)), config, Search(count=3))
        segmenter.configure(Config(criterion=criterion, threshold=1e-3))
        segmenter.process(Sweep(10**12, np.zeros((0, 3))))
    segment(np.random.default_rng(1).random((25_000, 3)))
    after = compiled()
    assert after == before, {k: v for k, v in after.items() if before.get(k) != v}


def test_forked_child_has_its_own_threads():
    code = (
        "import multiprocessing, numpy as np\n"
        "from ellipseg_ros.segmenter import segment\n"
        "points = np.random.default_rng(0).random((20_000, 3))\n"
        "segment(points)\n"
        "child = multiprocessing.get_context('fork').Process(target=segment, args=(points,))\n"
        "child.start(); child.join(); raise SystemExit(child.exitcode)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)
