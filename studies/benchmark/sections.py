"""All sections of the benchmark, by name."""

import gc
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from ellipseg_ros.config import Config
from ellipseg_ros.core.criteria import CRITERIA
from ellipseg_ros.segmenter import Segmenter
from ellipseg_ros.simulation.simulator import simulate
from studies.benchmark import batch, incremental, live, targets, tuning
from studies.benchmark.streams import FULL, SCENE, Sizes
from studies.report.machine import describe

SECTIONS: dict[str, Callable[[Sizes, str], dict[str, Any]]] = {  # of sizes and a recording
    "batch": lambda sizes, _: batch.batch(sizes),
    "peers": lambda sizes, _: batch.peer_times(sizes),
    "stages": lambda sizes, _: incremental.stage_times(sizes),
    "updates": lambda sizes, _: incremental.updates(sizes),
    "length": lambda sizes, _: incremental.lengths(sizes),
    "tuning": lambda sizes, _: tuning.curves(sizes),
    "publishing": lambda sizes, _: live.publishing(sizes),
    "latency": live.latency,
    "memory": lambda sizes, _: live.memory(sizes),
    "start": lambda sizes, _: live.start(sizes),
    "density": lambda sizes, _: incremental.densities(sizes),
    "data": lambda sizes, data: incremental.recording(data, sizes) if data else {},
}


def measure(
    names: list[str],
    sizes: Sizes,
    data: str = "",
    begin: Callable[[str], object] = lambda _: None,
) -> dict[str, Any]:
    """Measure the sections `names`; JSON-ready.

    data: a recording to measure as well. begin: called with the name of each section before it.
    After SIGINT, the sections that are finished are returned.
    """
    machine = describe()
    compile_kernels()
    gc.collect()
    gc.freeze()  # the collection before each timed call then has few objects to visit
    results: dict[str, Any] = {}
    for name in (name for name in SECTIONS if name in names):
        begin(name)
        try:
            measured = SECTIONS[name](sizes, data)
        except KeyboardInterrupt:
            if not results:
                raise
            break
        if measured:
            results[name] = measured
    head = {"machine": machine, "quick": sizes != FULL, "sizes": asdict(sizes)}
    return head | {"rows": targets.judged(results), "sections": results}


def compile_kernels() -> None:
    """Make a few updates with every criterion, so that no measurement includes a compilation."""
    for criterion in CRITERIA:
        segmenter = Segmenter(Config(criterion, window_duration=0.2))
        for sweep in simulate(SCENE, duration=0.5):
            segmenter.process(sweep)
