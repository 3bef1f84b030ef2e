"""The folder with the results of a run."""

import shutil
from argparse import Namespace
from importlib import import_module
from pathlib import Path

from ellipseg_ros.cli.report import Summary, print_status, print_summary, write_summary
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.formats import npz, ply
from ellipseg_ros.records import Segmentation

BAG = "bag"
SUMMARY = "summary.json"
LOG = "node.log"
PARAMETERS = "segmenter.yaml"
NPZ = "window.npz"
PLY = "window.ply"
VIEWS = ("segments.png", "ellipsoids.png", "segments_oblique.png", "ellipsoids_oblique.png")
NAMES = (BAG, SUMMARY, PARAMETERS, LOG, NPZ, PLY, *VIEWS, "levels.png")


def prepare(
    folder: Path, source: str, names: tuple[str, ...] = NAMES, keep: tuple[str, ...] = ()
) -> None:
    """Make the folder and remove the results of an earlier run.

    Raises EllipsegError if the folder holds any other file, or the source itself.
    source: the input of this run. names: of the results. keep: names that are not removed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = [path for path in folder.iterdir() if path.name not in keep]
    removable = {*names, *(f".{name}.part" for name in names)}  # also results written in part
    other_files = sorted(path.name for path in paths if path.name not in removable)
    if other_files:
        remedy = "give a new folder, or an empty folder, with -o"
        raise EllipsegError(f"{folder} holds {other_files[0]}; {remedy}")
    if folder.resolve() in (Path(source).resolve(), *Path(source).resolve().parents):
        raise EllipsegError(f"{source} is in {folder}, which is overwritten; give another -o")
    for path in paths:
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()


def require_plots(args: Namespace) -> None:
    """Raise ModuleNotFoundError now, not at the end of the run, if pictures can't be drawn."""
    if not args.no_pictures:
        import_module("ellipseg_ros.plots.window")


def finish(folder: Path, summary: Summary, result: Segmentation | None, args: Namespace) -> None:
    """Write the last window, its pictures and the summary with all files; print the summary."""
    if result is not None:
        npz.write(folder / NPZ, result)
        ply.write(folder / PLY, result)
        if not args.no_pictures:
            _draw(folder, result, args)
    written = {path.name for path in folder.iterdir()} | {SUMMARY}
    summary["files"] = [str(folder / name) for name in NAMES if name in written]
    write_summary(summary, folder / SUMMARY)
    print_summary(summary, args)


def _draw(folder: Path, result: Segmentation, args: Namespace) -> None:
    """Points and ellipsoids, from above and obliquely; segments, objects and truth."""
    from ellipseg_ros.plots import window as plots

    print_status("drawing ...", args)
    for view, suffix in ((plots.BIRDSEYE, ""), (plots.OBLIQUE, "_oblique")):
        plots.draw_segments(result, folder / f"segments{suffix}.png", view)
        plots.draw_ellipsoids(result, folder / f"ellipsoids{suffix}.png", view)
    plots.draw_levels(result, folder / "levels.png")
