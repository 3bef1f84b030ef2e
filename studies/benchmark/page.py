"""The page of the benchmark."""

from collections.abc import Callable
from typing import Any

from studies.report.page import Page, Section, Table, not_measured, number, quartiles
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
    rows = [
        [case["criterion"], number(case["threshold"]), f"{case['segments']:,}"]
        + [quartiles(case["batch_ms"]), quartiles(case.get("ratio"))]
        for case in section["cases"]
    ]
    if "knn_ms" in section:
        search = f"The 10-NN search of small_gicp takes {quartiles(section['knn_ms'])} ms."
    else:
        search = not_measured(section["missing"])
    return Section(
        "Batch",
        [
            f"`segment()` of {section['points']:,} simulated points. {search}",
            Table(["criterion", "threshold", "segments", "ms", "ratio to 10-NN"], rows),
        ],
    )


def _peers(section: Results) -> Section:
    rows = [["ellipseg_ros, shape", quartiles(section["ellipseg_ms"]), "", "the whole batch"]]
    rows += [
        [peer["name"], quartiles(peer["ms"]), peer["version"], peer["about"]]
        for peer in section["peers"]
    ]
    missing = [not_measured(section["missing"])] if section["missing"] else []
    table = Table(["library", "ms", "version", "operation"], rows)
    return Section("Other libraries", [f"The same {section['points']:,} points.", table, *missing])


def _stages(section: Results) -> Section:
    columns = [name for name in section["stages"][0] if name != "stage"]
    rows = [
        [row["stage"], *(quartiles(row[name]) for name in columns)] for row in section["stages"]
    ]
    head = ["stage", "batch, ms", *(f"update of {name}, ms" for name in columns[1:])]
    points = f"{section['points']:,} points"
    return Section(
        "Stages",
        [f"Criterion shape at its default threshold, {points} in the window.", Table(head, rows)],
    )


CASE = ["points", "segments", "largest", "update, ms", "batch, ms", "ratio"]


def _case(case: Results) -> list[str]:
    counts = [f"{case['points']:,}", f"{case['segments']:,}", f"{case['largest_share']:.0%}"]
    return counts + [quartiles(case[name]) for name in ("update_ms", "batch_ms", "ratio")]


def _updates(section: Results) -> Section:
    rows = [
        [f"{case['criterion']}, {case['kind']}", number(case["threshold"])]
        + [f"{case['period']:g} s", *_case(case)]
        for case in section["cases"]
    ]
    return Section(
        "Updates and batch",
        [
            f"A window of {section['window_s']:g} s of the simulated drive. *Largest*: share of "
            "the points in the largest segment.",
            Table(["criterion", "threshold", "update every", *CASE], rows),
        ],
    )


def _length(section: Results) -> Section:
    rows = [
        [f"{case['window_s']:g} s", f"{case['period']:g} s", *_case(case)]
        for case in section["cases"]
    ]
    return Section(
        "Window length",
        [
            "One simulated drive, all windows alternately.",
            Table(["window", "update every", *CASE], rows),
        ],
    )


def _density(section: Results) -> Section:
    rows = [
        [f"{case['points_per_second']:,}", f"{case['period']:g} s", *_case(case)]
        for case in section["cases"]
    ]
    return Section(
        "Points per second",
        [
            f"A window of {section['window_s']:g} s. The simulated vehicle drives an integer "
            "factor slower and is played back that much faster, as if it carried as many "
            "scanners; then the points are thinned evenly to the rate.",
            Table(["points/s", "update every", *CASE], rows),
        ],
    )


def _data(section: Results) -> Section:
    rows = [
        ["a cloud" if case["period"] < 1 else "10 clouds", *_case(case)]
        for case in section["cases"]
    ]
    batch = section["batch"]
    times = f"{quartiles(batch['batch_ms'])} ms"
    if "ratio" in batch:
        times += f", {quartiles(batch['ratio'])} times small_gicp's 10-NN"
    return Section(
        "Recording",
        [
            f"{section['source']}, thinned to {section['points_per_second']:,} points/s, a window "
            f"of {section['window_s']:.3g} s. Batch of {section['points']:,} points: {times}.",
            Table(["update every", *CASE], rows),
        ],
    )


def _tuning(section: Results) -> Section:
    rows = [
        [case["criterion"], str(case["thresholds"])]
        + [quartiles(case[name]) for name in ("batch_ms", "curve_ms", "ratio")]
        for case in section["cases"]
    ]
    return Section(
        "Tuning",
        [
            f"The AICc of {section['points']:,} simulated points at every threshold of the grid, "
            "as `ellipseg tune` computes it.",
            Table(["criterion", "thresholds", "batch, ms", "curve, ms", "ratio"], rows),
        ],
    )


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
    return Section(
        "Publishing",
        [
            f"{section['points']:,} points, {section['ellipsoids']:,} ellipsoids, three topics, a "
            "subscriber in another process.",
            Table(["step", "ms", "bytes"], rows),
        ],
    )


def _latency(section: Results) -> Section:
    rows = [
        [case["stream"], f"{case['points']:,}", f"{case['window_s']:g} s"]
        + [str(case["clouds"]), str(case["latency_ms"]["updates"])]
        + [number(case["latency_ms"][name]) for name in ("p50", "p99")]
        + [number(case["diagnostics_ms"][name]) for name in ("p50", "p99")]
        + [str(case["updates_coalesced"]), number(case["peak_memory_mb"])]
        for case in section["cases"]
    ]
    head = ["stream", "points", "window", "clouds", "updates", "p50, ms", "p99, ms"]
    head += ["node's p50, ms", "node's p99, ms", "coalesced", "peak, MB"]
    return Section(
        "Latency",
        [
            "The node over DDS, in real time, an update every "
            f"{section['update_period_s']:g} s: from the publication of a cloud until another "
            "process has received the last topic of its update, once the window is full. The "
            "node's own values are those of /diagnostics, without transport, over its last 100 "
            "updates. *Coalesced*: updates processed together because the node was behind, over "
            "the whole run.",
            Table(head, rows),
        ],
    )


def _memory(section: Results) -> Section:
    return Section(
        "Memory",
        [
            f"The node with {section['points']:,} points in its window of "
            f"{section['window_s']:g} s, at its default settings, with subscribers to all topics: "
            f"at most {number(section['peak_mb'])} MB resident."
        ],
    )


def _start(section: Results) -> Section:
    names = {"warm_s": "compiled cache warm", "cold_s": "compiled cache empty"}
    rows = [[text, quartiles(section[name])] for name, text in names.items() if name in section]
    return Section(
        "Start",
        ["From the start of the process until the node is ready.", Table(["start", "s"], rows)],
    )


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
