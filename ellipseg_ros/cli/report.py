"""Reports of a run: progress on stderr, and a summary as a table or as JSON."""

import json
import sys
import time
from argparse import Namespace
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from tqdm import tqdm  # widely used, small, and adapts to terminals

from ellipseg_ros.cli.settings import Settings
from ellipseg_ros.io.atomic_files import write_text
from ellipseg_ros.node.memory import peak_mb
from ellipseg_ros.records import SECOND, Segmentation, Sweep

Summary = dict[str, Any]  # nested, JSON-ready; names carry the unit
Progress: TypeAlias = "tqdm[Any]"


@dataclass
class Meter:
    """Measures the updates of a run."""

    times_s: list[float] = field(default_factory=list)  # of every update
    points: int = 0  # read
    sensor_ns: int = 0  # duration of the data, without jumps at restarts
    restarts: int = 0
    late: int = 0  # points older than the window when they arrived
    evicted: int = 0  # points that expired early because of `max_points`
    filtered: int = 0  # points removed by range or place in the sensor's frame
    unplaced: int = 0  # points without a pose
    started: float = field(default_factory=time.perf_counter)
    last: Segmentation | None = None

    def add(self, group: Sweep, result: Segmentation, time_s: float) -> None:
        """Count an update: its joined sweeps, the result, and the duration of `process`."""
        self.times_s.append(time_s)
        self.points += len(group)
        first = int(group.times_ns.min(initial=result.end_ns))
        begin = first if self.last is None or result.restart else self.last.end_ns
        self.sensor_ns += max(0, result.end_ns - begin)
        self.restarts += bool(result.restart)
        self.late += result.late
        self.evicted += result.evicted
        self.filtered += result.filtered
        self.unplaced += result.unplaced
        self.last = result

    def summary(self) -> Summary:
        """Counts, times, and the last window."""
        times = {"update_ms": percentiles(self.times_s), "peak_memory_mb": peak_mb()}
        return self.counts(time.perf_counter() - self.started) | times

    def counts(self, wall_s: float) -> Summary:
        """Counts and the last window; wall_s: duration of the run."""
        sensor_s = self.sensor_ns / SECOND
        return {
            "updates": len(self.times_s),
            "restarts": self.restarts,
            "points": self.points,
            "points_late": self.late,
            "points_expired_early": self.evicted,
            "points_filtered": self.filtered,
            "points_unplaced": self.unplaced,
            "sensor_s": round(sensor_s, 3),
            "wall_s": round(wall_s, 3),
            "times_real_time": round(sensor_s / wall_s, 2) if sensor_s else None,
            "window": window_summary(self.last) if self.last else None,
        }


def percentiles(times_s: list[float]) -> dict[str, float]:
    """Median, 99th percentile and maximum in ms of times in s; empty if there are none."""
    if not times_s:
        return {}
    median, p99, highest = np.percentile(np.array(times_s) * 1e3, [50, 99, 100])
    return {"median": round(median, 1), "p99": round(p99, 1), "max": round(highest, 1)}


def window_summary(result: Segmentation) -> Summary:
    """Numbers of points, segments and objects of a window, and its AICc."""
    counts = result.counts
    duration_ns = result.end_ns - int(result.times_ns.min(initial=result.end_ns))
    return {
        "points": len(result.labels),
        **asdict(counts),
        "seconds": round(duration_ns / SECOND, 3),
        "segments": len(result.ellipsoids),
        "segments_of_12_points": int((result.ellipsoids.count >= 12).sum()),
        "objects": None if result.objects is None else len(result.objects),
        "aicc": result.aicc,
        "aicc_per_point": result.aicc / max(1, counts.segmented),
    }


def heading(source: str, frame_id: str, settings: Settings) -> Summary:
    """The first entries of every summary: version, source and settings."""
    return {
        "ellipseg": version("ellipseg_ros"),
        "source": source,
        "frame_id": frame_id,
        "criterion": settings.config.criterion,
        "threshold": settings.config.tau,
        "settings": settings.flat(),
    }


def print_summary(summary: Summary, args: Namespace) -> None:
    """Print a summary as JSON or as a table; nothing with --quiet."""
    print_results(summary, (f"{name:<22} {text}" for name, text in _rows(summary)), args)


def print_results(results: Summary, lines: Iterable[str], args: Namespace) -> None:
    """Print results as JSON or as lines; nothing with --quiet."""
    if args.json:
        print(json.dumps(results, indent=2))
    elif not args.quiet:
        print("\n".join(lines))


def write_summary(summary: Summary, path: Path) -> None:
    """Write a summary as JSON."""
    write_text(path, json.dumps(summary, indent=2) + "\n")


def print_status(text: str, args: Namespace) -> None:
    """Print a status line to stderr; nothing with --quiet or --json."""
    if not (args.quiet or args.json):
        print(text, file=sys.stderr)


def compile_kernels(args: Namespace) -> None:
    """Compile all kernels, or load them from the cache, after a status line."""
    from ellipseg_ros.segmenter import warm_up  # only here: numba may not load

    print_status("compiling kernels, which takes longer the first time ...", args)
    warm_up()


def progress_bar(total: int | None, unit: str, args: Namespace) -> Progress:
    """A progress bar; shown only on a terminal, and not with --quiet or --json."""
    hidden = True if args.quiet or args.json else None  # None: only on a terminal
    return tqdm(total=total, unit=f" {unit}", disable=hidden, leave=False, dynamic_ncols=True)


def _rows(summary: Summary) -> Iterator[tuple[str, str]]:
    """The table: name and text of each row."""
    yield "source", f"{summary['source']} (frame {summary['frame_id'] or 'not named'})"
    yield "criterion", f"{summary['criterion']}, threshold {summary['threshold']:g}"
    yield from _run_rows(summary)
    if summary["window"]:
        yield from _window_rows(summary["window"])
    yield from summary.get("checks", {}).items()
    paths = [Path(path) for path in summary["files"]]
    yield "wrote", f"{paths[0].parent}/: {', '.join(path.name for path in paths)}"


def _run_rows(summary: Summary) -> Iterator[tuple[str, str]]:
    restarts = f", {summary['restarts']} restarts" if summary["restarts"] else ""
    yield "updates", f"{summary['updates']}{restarts}"
    yield "points read", f"{summary['points']:,}"
    if summary["points_late"]:
        yield "  late", f"{summary['points_late']:,}: older than the window when they arrived"
    if summary["points_expired_early"]:
        yield "  expired early", f"{summary['points_expired_early']:,}: `max_points` was reached"
    if summary["points_filtered"]:
        yield (
            "  filtered",
            f"{summary['points_filtered']:,}: see min_range, max_range, self_filter",
        )
    if summary["points_unplaced"]:
        yield "  unplaced", f"{summary['points_unplaced']:,}: there was no pose for them"
    if summary["times_real_time"]:
        duration = f"{summary['sensor_s']:.1f} s of data in {summary['wall_s']:.1f} s"
        yield "speed", f"{duration}: {summary['times_real_time']:g} x real time"
    for name, key in (("time per update", "update_ms"), ("latency", "latency_ms")):
        times = summary.get(key)
        if times:
            yield name, f"median {times['median']:g} ms, p99 {times['p99']:g} ms"
    yield "peak memory", f"{summary['peak_memory_mb']:.0f} MB"


def _window_rows(window: Summary) -> Iterator[tuple[str, str]]:
    yield "last window", f"{window['points']:,} points of {window['seconds']:.1f} s"
    for fate in ("segmented", "isolated", "rejected", "thinned"):
        yield f"  {fate}", f"{window[fate]:,}"
    large = f"{window['segments_of_12_points']:,} of 12 points or more"
    yield "segments", f"{window['segments']:,} ({large})"
    if window["objects"] is not None:
        yield "objects", f"{window['objects']:,}"
    yield "AICc", f"{window['aicc']:.6g} ({window['aicc_per_point']:.3f} per point)"
