"""`ellipseg tune`: find the threshold with the lowest AICc over the windows of all sources."""

import os
from argparse import Namespace
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path

from ellipseg_ros.cli import tune_results
from ellipseg_ros.cli.report import compile_kernels, print_status, progress_bar
from ellipseg_ros.cli.results import prepare, require_plots
from ellipseg_ros.cli.settings import Settings, read_settings
from ellipseg_ros.cli.sources import open_input
from ellipseg_ros.cli.tune_results import CurveStore, TuningRun
from ellipseg_ros.core.criteria import CRITERIA
from ellipseg_ros.errors import ConfigError, EllipsegError
from ellipseg_ros.io.sources import Source
from ellipseg_ros.tuning import parallel
from ellipseg_ros.tuning.search import Search
from ellipseg_ros.tuning.tasks import Task
from ellipseg_ros.tuning.windows import windows

ALL = "all"  # criteria


def run(args: Namespace) -> int:
    """Tune on `args.sources` and write the results; returns 1 if a window has failed."""
    require_plots(args)
    use_all = args.criterion == ALL
    options = vars(args) | ({"criterion": None} if use_all else {})
    settings = read_settings(Namespace(**options))
    grid = {"lowest": args.lowest, "highest": args.highest, "count": args.count}
    search = Search(**{name: value for name, value in grid.items() if value is not None})
    criteria = tuple(CRITERIA) if use_all else (settings.config.criterion,)
    for criterion in criteria:
        search.grid(criterion)  # reports an invalid range here, not in every window
    specs = dict.fromkeys(args.sources)
    sources = {spec: open_input(spec, args, settings.placement) for spec in specs}
    first = next(iter(sources.values()))
    folder = Path(args.output or f"{first.name}_tuned")
    for spec in sources:
        prepare(folder, spec, tune_results.NAMES, keep=(tune_results.WINDOWS,))
    compile_kernels(args)
    tuning = TuningRun(list(sources), settings, criteria)
    tasks, total = _tasks(sources, search, tuning, args), _expected(sources, settings, args)
    _run_all(tasks, total, tuning, CurveStore(folder), args)
    if not tuning.results:
        raise EllipsegError(f"no window could be tuned: {'; '.join(tuning.problems[:3])}")
    tune_results.finish(folder, tuning, args)
    return 1 if tuning.problems else 0


def _run_all(
    tasks: Iterator[Task], total: int | None, tuning: TuningRun, store: CurveStore, args: Namespace
) -> None:
    """Tune every window that is not in the store; store each as soon as it is finished."""
    with progress_bar(total, "windows", args) as bar, _workers(total, args) as workers:

        def unfinished() -> Iterator[Task]:
            for task in tasks:
                curves = store.get(task.key)
                if curves is None:
                    yield task
                else:
                    tuning.add(task.cut, curves, reused=True)
                    bar.update()

        for task, curves, problem in parallel.outcomes(unfinished(), workers):
            if curves is None:
                tuning.problems.append(f"window {task.cut.number} of {task.cut.source}: {problem}")
                print_status(tuning.problems[-1], args)
            else:
                store.put(task.key, curves)
                tuning.add(task.cut, curves)
            bar.update()


def _tasks(
    sources: dict[str, Source], search: Search, tuning: TuningRun, args: Namespace
) -> Iterator[Task]:
    """Yield the windows of all sources; an unreadable rest of a source is noted as a problem."""
    config = tuning.settings.config
    for spec, source in sources.items():
        try:
            for cut in windows(spec, source, config, args.every):
                yield Task(cut, config, tuning.criteria, search)
        except EllipsegError as error:
            tuning.problems.append(str(error) if spec in str(error) else f"{spec}: {error}")
            print_status(tuning.problems[-1], args)


def _expected(sources: dict[str, Source], settings: Settings, args: Namespace) -> int | None:
    """Approximate number of windows; None if the duration of a source is not known."""
    every = settings.config.window_duration if args.every is None else args.every
    if not every > 0.0:
        raise ConfigError(f"--every is {every:g}; it must be more than 0 s")
    durations = [source.duration for source in sources.values()]
    if None in durations:
        return None
    return sum(max(1, round((duration or 0.0) / every)) for duration in durations)


def _workers(total: int | None, args: Namespace) -> AbstractContextManager[parallel.Workers]:
    """A cluster, processes, or for a single window the threads of this process."""
    if args.scheduler:
        return parallel.dask(args.scheduler)
    jobs = len(os.sched_getaffinity(0)) if args.jobs is None else args.jobs
    if jobs < 1:
        raise ConfigError(f"--jobs is {jobs}; it must be at least 1")
    if total == 1 and args.jobs is None:
        return parallel.this_process()
    return parallel.processes(min(jobs, total or jobs))
