"""What a run says of itself: progress while it lasts, then a summary to read or to parse."""

import json
import resource
import sys
import time
from argparse import Namespace
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from tqdm import tqdm  # the usual one: small, and it knows terminals

from ellipseg_ros.cli.settings import Settings
from ellipseg_ros.io.atomic_files import write_text
from ellipseg_ros.records import SECOND, Segmentation, Sweep

Summary = dict[str, Any]  # nested, JSON-ready; names carry the unit
Progress: TypeAlias = "tqdm[Any]"


@dataclass
class Meter:
    """Measures the updates of a run."""

    times_s: list[float] = field(default_factory=list)  # of every update
    points: int = 0  # read in all
    sensor_ns: int = 0  # time that the data span, restarts taken out
    restarts: int = 0
    late: int = 0  # points older than the window when they came
    evicted: int = 0  # points that `max_points` let expire early
    started: float = field(default_factory=time.perf_counter)
    last: Segmentation | None = None

    @contextmanager
    def update(self, group: Sweep) -> Iterator[None]:
        """Time one update: the `with` block segments `group`."""
        self.points += len(group)
        start = time.perf_counter()
        yield
        self.times_s.append(time.perf_counter() - start)

    def take(self, group: Sweep, found: Segmentation) -> None:
        """Note the result of an update."""
        goes_on = self.last is not None and not found.restart
        begin = (
            self.last.end_ns
            if self.last and goes_on
            else int(group.times_ns.min(initial=found.end_ns))
        )
        self.sensor_ns += max(0, found.end_ns - begin)
        self.restarts += bool(found.restart)
        self.late += found.late
        self.evicted += found.evicted
        self.last = found

    def summary(self) -> Summary:
        """Counts and times; the window is the last one."""
        wall = time.perf_counter() - self.started
        sensor = self.sensor_ns / SECOND
        return {
            "updates": len(self.times_s),
            "restarts": self.restarts,
            "points": self.points,
            "points_late": self.late,
            "points_expired_early": self.evicted,
            "sensor_s": round(sensor, 3),
            "wall_s": round(wall, 3),
            "times_real_time": round(sensor / wall, 2) if sensor else None,
            "update_ms": percentiles(self.times_s),
            "peak_memory_mb": peak_memory_mb(),
            "window": window_summary(self.last) if self.last else None,
        }


def percentiles(times_s: list[float]) -> dict[str, float]:
    """Seconds to their median, p99 and maximum in ms; empty if there are none."""
    if not times_s:
        return {}
    median, p99, most = np.percentile(np.array(times_s) * 1e3, [50, 99, 100])
    return {"median": round(median, 1), "p99": round(p99, 1), "max": round(most, 1)}


def peak_memory_mb() -> float:
    """Most memory that this process has ever held, in MB (10^6 bytes); Linux counts in KiB."""
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6, 1)


def window_summary(found: Segmentation) -> Summary:
    """What a window holds."""
    counts = found.counts
    return {
        "points": len(found.labels),
        "segmented": counts.segmented,
        "isolated": counts.isolated,
        "rejected": counts.rejected,
        "thinned": counts.thinned,
        "seconds": round(
            (found.end_ns - int(found.times_ns.min(initial=found.end_ns))) / SECOND, 3
        ),
        "segments": len(found.ellipsoids),
        "segments_of_12_points": int((found.ellipsoids.count >= 12).sum()),
        "objects": None if found.objects is None else len(found.objects),
        "aicc": found.aicc,
        "aicc_per_point": found.aicc / max(1, counts.segmented),
    }


def heading(source: str, frame_id: str, settings: Settings) -> Summary:
    """Where results come from: the first lines of every summary."""
    return {
        "ellipseg": version("ellipseg_ros"),
        "source": source,
        "frame_id": frame_id,
        "criterion": settings.config.criterion,
        "threshold": settings.config.tau,
        "settings": settings.flat(),
    }


def show(summary: Summary, args: Namespace) -> None:
    """Print the summary: as JSON, as a table, or not at all."""
    if args.json:
        print(json.dumps(summary, indent=2))
    elif not args.quiet:
        print("\n".join(f"{name:<22} {text}" for name, text in _rows(summary)))


def write(summary: Summary, path: Path) -> None:
    """Write the summary as JSON."""
    write_text(path, json.dumps(summary, indent=2) + "\n")


def say(text: str, args: Namespace) -> None:
    """A line for whoever watches: to stderr, so that --json and pipes stay clean."""
    if not (args.quiet or args.json):
        print(text, file=sys.stderr)


def progress(total: int | None, unit: str, args: Namespace) -> Progress:
    """A bar for long work; only on a terminal, and not with --quiet or --json."""
    hidden = True if args.quiet or args.json else None  # None: tqdm looks for the terminal
    return tqdm(total=total, unit=f" {unit}", disable=hidden, leave=False, dynamic_ncols=True)


@contextmanager
def steps(total: int, unit: str, args: Namespace) -> Iterator[Callable[[str], None]]:
    """A bar, and what to call with a few words before each step of long work."""
    with progress(total, unit, args) as bar:

        def begin(what: str) -> None:
            bar.set_description(what)
            bar.update()
            if bar.disable:  # no terminal: lines instead of a bar
                say(f"{what} ...", args)

        yield begin


def show_page(results: Summary, blocks: Callable[[Summary], list[str]], args: Namespace) -> None:
    """Print results: as JSON, as the blocks of their page, or not at all."""
    if args.json:
        print(json.dumps(results, indent=2))
    elif not args.quiet:
        print("\n".join(blocks(results)))


def _rows(summary: Summary) -> Iterator[tuple[str, str]]:
    """The table: what the JSON holds, for people."""
    yield "source", f"{summary['source']} (frame {summary['frame_id'] or 'not named'})"
    yield "criterion", f"{summary['criterion']}, threshold {summary['threshold']:g}"
    yield from _run_rows(summary)
    if summary["window"]:
        yield from _window_rows(summary["window"])
    for name, text in summary.get("checks", {}).items():
        yield name, str(text)
    if summary.get("files"):
        paths = [Path(path) for path in summary["files"]]
        yield "wrote", f"{paths[0].parent}/: {', '.join(path.name for path in paths)}"


def _run_rows(summary: Summary) -> Iterator[tuple[str, str]]:
    restarts = f", {summary['restarts']} restarts" if summary["restarts"] else ""
    yield "updates", f"{summary['updates']}{restarts}"
    yield "points read", f"{summary['points']:,}"
    if summary["points_late"]:
        yield "  late", f"{summary['points_late']:,}: older than the window when they came"
    if summary["points_expired_early"]:
        yield "  expired early", f"{summary['points_expired_early']:,}: `max_points` was reached"
    if summary["times_real_time"]:
        took = f"{summary['sensor_s']:.1f} s of data in {summary['wall_s']:.1f} s"
        yield "speed", f"{took}: {summary['times_real_time']:g} x real time"
    times = summary["update_ms"]
    if times:
        yield "time per update", f"median {times['median']:g} ms, p99 {times['p99']:g} ms"
    times = summary.get("latency_ms")
    if times:
        yield "latency", f"median {times['median']:g} ms, p99 {times['p99']:g} ms"
    yield "peak memory", f"{summary['peak_memory_mb']:.0f} MB"


def _window_rows(window: Summary) -> Iterator[tuple[str, str]]:
    yield "last window", f"{window['points']:,} points of {window['seconds']:.1f} s"
    for fate in ("segmented", "isolated", "rejected", "thinned"):
        yield f"  {fate}", f"{window[fate]:,}"
    yield (
        "segments",
        f"{window['segments']:,} ({window['segments_of_12_points']:,} of 12 points or more)",
    )
    if window["objects"] is not None:
        yield "objects", f"{window['objects']:,}"
    yield "AICc", f"{window['aicc']:.6g} ({window['aicc_per_point']:.3f} a point)"
