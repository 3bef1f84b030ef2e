"""The folder that a run writes: prepared before, filled at the end."""

import shutil
from argparse import Namespace
from pathlib import Path

from ellipseg_ros.cli.report import Summary, say, write
from ellipseg_ros.errors import EllipsegError
from ellipseg_ros.io.formats import npz, ply
from ellipseg_ros.records import Segmentation

BAG = "bag"
SUMMARY = "summary.json"
LOG = "node.log"
PARAMETERS = "segmenter.yaml"
NPZ = "window.npz"
PLY = "window.ply"
PICTURES = (
    "segments.png",
    "ellipsoids.png",
    "segments_oblique.png",
    "ellipsoids_oblique.png",
    "levels.png",
)
NAMES = (BAG, SUMMARY, PARAMETERS, LOG, NPZ, PLY, *PICTURES)


def prepare(
    folder: Path, source: str, names: tuple[str, ...] = NAMES, keep: tuple[str, ...] = ()
) -> None:
    """Make the folder; results of an earlier run go, anything else in it is left and refused.

    source: what is going to be read, which must not be among what goes. names: of the results.
    keep: what may be there and stays.
    """
    folder.mkdir(parents=True, exist_ok=True)
    there = [path for path in folder.iterdir() if path.name not in keep]
    foreign = sorted(path.name for path in there if not _ours(path.name, names))
    if foreign:
        raise EllipsegError(
            f"{folder} holds {foreign[0]}; give a new folder, or an empty one, with -o"
        )
    if folder.resolve() in (Path(source).resolve(), *Path(source).resolve().parents):
        raise EllipsegError(f"{source} lies in {folder}, which is written anew; give another -o")
    for path in there:
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()


def finish(folder: Path, summary: Summary, found: Segmentation | None, args: Namespace) -> None:
    """Write the last window, its pictures and the summary, which then lists all files."""
    if found is not None:
        npz.write(folder / NPZ, found)
        ply.write(folder / PLY, found)
        if not args.no_pictures:
            _draw(folder, found, args)
    here = {path.name for path in folder.iterdir()} | {SUMMARY}
    summary["files"] = [str(folder / name) for name in NAMES if name in here]
    write(summary, folder / SUMMARY)


def _ours(name: str, names: tuple[str, ...]) -> bool:
    """Whether an earlier run has written it, perhaps by half."""
    return name in names or name in {f".{one}.part" for one in names}


def _draw(folder: Path, found: Segmentation, args: Namespace) -> None:
    """Points and ellipsoids, from above and obliquely; segments, objects and truth."""
    from ellipseg_ros.plots import window as plots

    say("drawing ...", args)
    for view, suffix in ((plots.BIRDSEYE, ""), (plots.OBLIQUE, "_oblique")):
        plots.draw_segments(found, folder / f"segments{suffix}.png", view)
        plots.draw_ellipsoids(found, folder / f"ellipsoids{suffix}.png", view)
    plots.draw_levels(found, folder / "levels.png")
