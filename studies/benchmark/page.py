"""The results as Markdown, which a terminal shows as well: tables, and how they were measured."""

from collections.abc import Callable
from typing import Any

from studies.report.markdown import (
    Cells,
    between,
    machine_line,
    not_measured,
    number,
    table,
)

Results = dict[str, Any]

INTRODUCTION = """# Benchmarks

Written by `ellipseg bench`; every number was measured by it, in one run. To measure again:

```bash
pip install -e '.[bench]'  # what it is compared with
ellipseg bench -o docs
```

What is compared was run in turn, and every ratio is of two times taken right after one another.
Given are medians, with quartiles in brackets where there were several runs. One update is one call
of `Segmenter.process`; batch is `segment()` of the same points with the same origin. Objects are
grouped in "Where the time goes" and by the node, nowhere else.
"""
QUICK = """**Measured with `--quick`**: small windows, few runs; the promises
are about 150,000 points.
"""
PICTURE = "![The same numbers as a picture](benchmarks.png)\n"


def page(results: Results) -> str:
    """All of docs/benchmarks.md."""
    return "\n".join([INTRODUCTION, PICTURE, *blocks(results)])


def blocks(results: Results) -> list[str]:
    """The machine, the promises, and a block for every section that was measured."""
    sections = results["sections"]
    written = [write(sections[name]) for name, write in WRITERS.items() if name in sections]
    quick = [QUICK] if results["quick"] else []
    return [machine_line(results["machine"]), *quick, _promises(results["rows"]), *written]


def _promises(rows: list[Results]) -> str:
    cells = []
    for row in rows:
        limits = [f"≤ {row[name]:g} {row['unit']}".rstrip() for name in ("must", "aim")]
        measured = between(row["value"])
        runs = str(row["value"]["runs"]) if row["value"] else "-"
        if row["value"] and row["unit"]:
            measured += f" {row['unit']}"
        cells.append([row["title"], *limits, measured, runs, row["reached"]])
    head = ["what", "must", "aim", "measured", "runs", "reached"]
    return "## What was promised\n\n" + table(head, cells)


def _batch(section: Results) -> str:
    rows = [
        [case["criterion"], number(case["threshold"]), f"{case['segments']:,}"]
        + [between(case["batch_ms"]), between(case.get("ratio"))]
        for case in section["cases"]
    ]
    if "knn_ms" in section:
        beside = f"small_gicp's 10-NN of the same points: {between(section['knn_ms'])} ms."
    else:
        beside = not_measured(section["missing"])
    return (
        f"## Batch\n\n`segment()` of {section['points']:,} simulated points. {beside}\n\n"
        + table(["criterion", "threshold", "segments", "ms", "ratio to 10-NN"], rows)
    )


def _peers(section: Results) -> str:
    rows = [["ellipseg_ros, shape", between(section["ellipseg_ms"]), "", "the whole batch"]]
    rows += [
        [peer["name"], between(peer["ms"]), peer["version"], peer["about"]]
        for peer in section["peers"]
    ]
    text = f"## Peers\n\nThe same {section['points']:,} points.\n\n"
    text += table(["what", "ms", "version", "how"], rows)
    return text + (f"\n{not_measured(section['missing'])}\n" if section["missing"] else "")


def _stages(section: Results) -> str:
    columns = [name for name in section["stages"][0] if name != "stage"]
    rows = [[row["stage"], *(between(row[name]) for name in columns)] for row in section["stages"]]
    heads = ["batch, ms", *(f"update of {name}, ms" for name in columns[1:])]
    return (
        f"## Where the time goes\n\nshape, at its default threshold, {section['points']:,} points "
        "in the window.\n\n" + table(["stage", *heads], rows)
    )


def _updates(section: Results) -> str:
    rows = [
        [f"{case['criterion']}, {case['kind']}", number(case["threshold"])]
        + [f"{case['period']:g} s", *_case(case)]
        for case in section["cases"]
    ]
    return (
        f"## Updates and batch\n\nA window of {section['window_s']:g} s of the simulated drive. "
        "`largest`: share of the points in the largest segment.\n\n"
        + table(["criterion", "threshold", "update every", *CASE], rows)
    )


CASE = ["points", "segments", "largest", "update, ms", "batch, ms", "ratio"]


def _case(case: Results) -> Cells:
    counts = [f"{case['points']:,}", f"{case['segments']:,}", f"{case['largest_share']:.0%}"]
    return counts + [between(case[name]) for name in ("update_ms", "batch_ms", "ratio")]


def _length(section: Results) -> str:
    cases = section["cases"]
    rows = [[f"{case['window_s']:g} s", f"{case['period']:g} s", *_case(case)] for case in cases]
    return "## Length of the window\n\nOne simulated drive, all windows in turn.\n\n" + table(
        ["window", "update every", *CASE], rows
    )


def _density(section: Results) -> str:
    rows = [
        [f"{case['points_per_second']:,}", f"{case['period']:g} s", *_case(case)]
        for case in section["cases"]
    ]
    return (
        f"## Points per second\n\nA window of {section['window_s']:g} s. The simulated vehicle "
        "drives a whole number of times slower and is played back that much faster, as if it "
        "carried so many scanners; then points are left out evenly, down to the rate.\n\n"
        + table(["points/s", "update every", *CASE], rows)
    )


def _data(section: Results) -> str:
    rows = [
        ["a cloud" if case["period"] < 1 else "10 clouds", *_case(case)]
        for case in section["cases"]
    ]
    batch = section["batch"]
    beside = f", {between(batch['ratio'])} of small_gicp's 10-NN" if "ratio" in batch else ""
    return (
        f"## A recording\n\n{section['source']}, thinned to {section['points_per_second']:,} "
        f"points/s, a window of {section['window_s']:.3g} s. Batch of {section['points']:,} "
        f"points: {between(batch['batch_ms'])} ms{beside}.\n\n"
        + table(["update every", *CASE], rows)
    )


def _tuning(section: Results) -> str:
    rows = [
        [case["criterion"], str(case["thresholds"])]
        + [between(case[name]) for name in ("batch_ms", "curve_ms", "ratio")]
        for case in section["cases"]
    ]
    head = ["criterion", "thresholds", "batch, ms", "curve, ms", "ratio"]
    return (
        f"## Tuning\n\nThe AICc of {section['points']:,} simulated points at every threshold of\n"
        "the grid, as `ellipseg tune` computes it.\n\n" + table(head, rows)
    )


def _publishing(section: Results) -> str:
    rows = [
        [f"build {name}", between(value), f"{section['bytes'][name]:,}"]
        for name, value in section["build_ms"].items()
    ]
    rows += [
        ["build and publish, everything changed", between(section["publish_ms"]), ""],
        ["build and publish, nothing changed", between(section["publish_unchanged_ms"]), ""],
        ["until received, everything changed", between(section["received_ms"]), ""],
    ]
    return (
        f"## Publishing\n\n{section['points']:,} points, {section['ellipsoids']:,} ellipsoids, "
        "all three topics, a subscriber in another process.\n\n"
        + table(["what", "ms", "bytes"], rows)
    )


def _latency(section: Results) -> str:
    rows = [
        [case["stream"], f"{case['points']:,}", f"{case['window_s']:g} s"]
        + [str(case["clouds"]), str(case["latency_ms"]["updates"])]
        + [number(case["latency_ms"][name]) for name in ("p50", "p99")]
        + [number(case["diagnostics_ms"][name]) for name in ("p50", "p99")]
        + [str(case["updates_joined"]), number(case["peak_memory_mb"])]
        for case in section["cases"]
    ]
    head = ["stream", "points", "window", "clouds", "updates", "p50, ms", "p99, ms"]
    head += ["node's p50, ms", "node's p99, ms", "joined", "peak, MB"]
    return (
        "## Latency\n\nThe real node over DDS, in real time, an update every "
        f"{section['update_period_s']:g} s: from a cloud sent until the last topic of its update "
        "has reached another process, once the window is full. The node's own numbers are those "
        "of /diagnostics, without the transport, over its last 100 updates. `joined`: updates "
        "taken together because the node was behind, over the whole run.\n\n" + table(head, rows)
    )


def _memory(section: Results) -> str:
    return (
        f"## Memory\n\nThe node with {section['points']:,} points in its window of "
        f"{section['window_s']:g} s, at its default settings, all topics subscribed: at most "
        f"{number(section['peak_mb'])} MB resident.\n"
    )


def _start(section: Results) -> str:
    names = {"warm_s": "compiled cache warm", "cold_s": "cache empty: everything is compiled"}
    rows = [[text, between(section[name])] for name, text in names.items() if name in section]
    return (
        "## Start\n\nFrom the start of the process until the node says that it is ready.\n\n"
        + table(["start", "s"], rows)
    )


WRITERS: dict[str, Callable[[Results], str]] = {
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
