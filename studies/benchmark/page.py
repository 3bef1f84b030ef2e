"""The page of the benchmark."""

from collections.abc import Callable
from typing import Any

from studies.report.page import (
    Cell,
    Page,
    Section,
    Table,
    not_measured,
    number,
    numbers,
    quartiles,
    spreads,
    table_of,
    text,
)
from studies.report.requirements import requirement_table

Results = dict[str, Any]

COMMAND = """
pip install -e '.[bench]'  # the libraries it is compared with
python -m studies.benchmark -o docs/results
"""
INTRODUCTION = (
    "Speed, latency and memory of this package, beside other libraries on the same points. An "
    "*update* is one call of `Segmenter.process`, a *batch* is `segment()` of the same points and "
    "origin. Values are medians, with quartiles in brackets where there were several "
    "runs. Objects are grouped only in the section on stages and by the node; landmarks likewise."
)
METHOD = (
    "All numbers are of one run. What is compared runs alternately, and every ratio is of two "
    "times measured right after one another."
)
QUICK = (
    "**Measured with `--quick`**: small windows and few runs, whereas the requirements hold for "
    "about 150,000 points."
)


def page(results: Results) -> Page:
    """Requirements, then a section for everything that was measured."""
    sections = results["sections"]
    quick = [QUICK] if results["quick"] else []
    rows = requirement_table(results["rows"])
    return Page(
        name="benchmark",
        title="Benchmark",
        introduction=[INTRODUCTION],
        chart="Requirements, stages, window lengths and point rates as charts",
        sections=[
            Section("Requirements", [*quick, rows]),
            *(build(sections[name]) for name, build in SECTIONS.items() if name in sections),
        ],
        method=[METHOD],
        machine=results["machine"],
        command=COMMAND,
    )


def _batch(section: Results) -> Section:
    if "knn_ms" in section:
        search = f"The 10-NN search of small_gicp takes {quartiles(section['knn_ms'])} ms."
    else:
        search = not_measured(section["missing"])
    about = f"`segment()` of {section['points']:,} simulated points. {search}"
    columns = {"criterion": text("criterion"), "threshold": numbers("threshold")}
    columns |= {"segments": text("segments", ","), "ms": spreads("batch_ms")}
    columns |= {"ratio to 10-NN": spreads("ratio")}
    return Section("Batch", [about, table_of(section["cases"], columns)])


def _peers(section: Results) -> Section:
    ours = {"name": "ellipseg_ros, shape", "ms": section["ellipseg_ms"], "version": ""}
    rows = [ours | {"about": "the whole batch"}, *section["peers"]]
    columns = {"library": text("name"), "ms": spreads("ms")}
    columns |= {"version": text("version"), "operation": text("about")}
    missing = [not_measured(section["missing"])] if section["missing"] else []
    about = f"The same {section['points']:,} points."
    return Section("Other libraries", [about, table_of(rows, columns), *missing])


def _stages(section: Results) -> Section:
    names = [name for name in section["stages"][0] if name not in ("stage", "batch")]
    columns = {"stage": text("stage"), "batch, ms": spreads("batch")}
    columns |= {f"update of {name}, ms": spreads(name) for name in names}
    points = f"{section['points']:,} points"
    about = f"Criterion shape at its default threshold, {points} in the window."
    return Section("Stages", [about, table_of(section["stages"], columns)])


PERIOD = {"update every": lambda case: f"{case['period']:g} s"}
CASE = {
    "points": text("points", ","),
    "segments": text("segments", ","),
    "largest": text("largest_share", ".0%"),
    "update, ms": spreads("update_ms"),
    "batch, ms": spreads("batch_ms"),
    "ratio": spreads("ratio"),
}


def _updates(section: Results) -> Section:
    columns = {"criterion": lambda case: f"{case['criterion']}, {case['kind']}"}
    columns |= {"threshold": numbers("threshold")} | PERIOD | CASE
    about = (
        f"A window of {section['window_s']:g} s of the simulated drive. *Largest*: share of the "
        "points in the largest segment."
    )
    return Section("Updates and batch", [about, table_of(section["cases"], columns)])


def _length(section: Results) -> Section:
    columns = {"window": lambda case: f"{case['window_s']:g} s"} | PERIOD | CASE
    about = "One simulated drive, all windows alternately."
    return Section("Window length", [about, table_of(section["cases"], columns)])


def _density(section: Results) -> Section:
    about = (
        f"A window of {section['window_s']:g} s. The simulated vehicle drives an integer factor "
        "slower and is played back that much faster, as if it carried as many scanners; then the "
        "points are thinned evenly to the rate."
    )
    columns = {"points/s": text("points_per_second", ",")} | PERIOD | CASE
    return Section("Points per second", [about, table_of(section["cases"], columns)])


def _data(section: Results) -> Section:
    batch = section["batch"]
    times = f"{quartiles(batch['batch_ms'])} ms"
    if "ratio" in batch:
        times += f", {quartiles(batch['ratio'])} times small_gicp's 10-NN"
    about = (
        f"{section['source']}, thinned to {section['points_per_second']:,} points/s, a window of "
        f"{section['window_s']:.3g} s. Batch of {section['points']:,} points: {times}."
    )
    period = {"update every": lambda case: "a cloud" if case["period"] < 1 else "10 clouds"}
    return Section("Recording", [about, table_of(section["cases"], period | CASE)])


def _tuning(section: Results) -> Section:
    columns = {"criterion": text("criterion"), "thresholds": text("thresholds")}
    columns |= {"batch, ms": spreads("batch_ms"), "curve, ms": spreads("curve_ms")}
    columns |= {"ratio": spreads("ratio")}
    about = (
        f"The AICc of {section['points']:,} simulated points at every threshold of the grid, as "
        "`ellipseg tune` computes it."
    )
    return Section("Tuning", [about, table_of(section["cases"], columns)])


def _publishing(section: Results) -> Section:
    rows = [
        [f"build {name}", quartiles(value), f"{section['bytes'][name]:,}"]
        for name, value in section["build_ms"].items()
    ]
    rows += [
        ["build and publish, everything changed", quartiles(section["publish_ms"]), ""],
        ["build and publish, nothing changed", quartiles(section["publish_unchanged_ms"]), ""],
        ["until received, everything changed", quartiles(section["received_ms"]), ""],
    ]
    about = (
        f"{section['points']:,} points, {section['ellipsoids']:,} ellipsoids, three topics, a "
        "subscriber in another process."
    )
    return Section("Publishing", [about, Table(["step", "ms", "bytes"], rows)])


def _latency(section: Results) -> Section:
    about = (
        f"The node over DDS, in real time, an update every {section['update_period_s']:g} s: from "
        "the publication of a cloud until another process has received the last topic of its "
        "update, once the window is full. The node's own values are those of /diagnostics, "
        "without transport, over its last 100 updates. *Coalesced*: updates processed together "
        "because the node was behind, over the whole run."
    )
    columns: dict[str, Cell] = {
        "stream": text("stream"),
        "points": text("points", ","),
        "window": lambda case: f"{case['window_s']:g} s",
        "clouds": text("clouds"),
        "updates": lambda case: str(case["latency_ms"]["updates"]),
        "p50, ms": lambda case: number(case["latency_ms"]["p50"]),
        "p99, ms": lambda case: number(case["latency_ms"]["p99"]),
        "node's p50, ms": lambda case: number(case["diagnostics_ms"]["p50"]),
        "node's p99, ms": lambda case: number(case["diagnostics_ms"]["p99"]),
        "coalesced": text("updates_coalesced"),
        "peak, MB": numbers("peak_memory_mb"),
    }
    return Section("Latency", [about, table_of(section["cases"], columns)])


def _memory(section: Results) -> Section:
    about = (
        f"The node with {section['points']:,} points in its window of {section['window_s']:g} s, "
        "at its default settings, with subscribers to all topics: at most "
        f"{number(section['peak_mb'])} MB resident."
    )
    return Section("Memory", [about])


def _start(section: Results) -> Section:
    names = {"warm_s": "compiled cache warm", "cold_s": "compiled cache empty"}
    rows = [[what, quartiles(section[key])] for key, what in names.items() if key in section]
    about = "From the start of the process until the node is ready."
    return Section("Start", [about, Table(["start", "s"], rows)])


SECTIONS: dict[str, Callable[[Results], Section]] = {
    "batch": _batch,
    "peers": _peers,
    "stages": _stages,
    "updates": _updates,
    "length": _length,
    "density": _density,
    "data": _data,
    "tuning": _tuning,
    "publishing": _publishing,
    "latency": _latency,
    "memory": _memory,
    "start": _start,
}
