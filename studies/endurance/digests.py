"""Digests of segmentations, to compare results bit for bit.

Imports no more than segmentation needs: other versions of Python run it, too.
"""

import hashlib
import json
import sys
from collections.abc import Iterable, Iterator

import numpy as np

from ellipseg_ros.config import Config, ObjectsConfig
from ellipseg_ros.node.grouping import updates
from ellipseg_ros.records import Segmentation, Sweep
from ellipseg_ros.segmenter import Segmenter
from ellipseg_ros.simulation.simulator import simulate

SCENES = ("woodland", "industrial", "roadway", "mixed")
CRITERIA = ("shape", "density", "parsimony")
DURATION = 3.0  # s of driving


def last_update(sweeps: Iterable[Sweep], criterion: str = "shape") -> Segmentation:
    """The last window of a drive; objects with the criterion `shape` only."""
    config = Config(criterion, objects=ObjectsConfig(enabled=criterion == "shape"))
    segmenter = Segmenter(config)
    *_, last = (segmenter.process(group) for group in updates(sweeps, config))
    return last


def digest(segmentation: Segmentation) -> str:
    """SHA-256 of labels, moments and objects, which do not depend on earlier updates."""
    columns = [segmentation.labels, *vars(segmentation.ellipsoids).values()]
    objects = segmentation.objects
    if objects is not None:
        columns += [objects.segment_labels, objects.box_min, objects.hierarchy.cost]
    sums = hashlib.sha256()
    for column in columns:
        sums.update(np.ascontiguousarray(column).tobytes())
    return sums.hexdigest()


def in_pieces(sweeps: Iterable[Sweep], pieces: int) -> Iterator[Sweep]:
    """Yield the same points with every sweep cut into several of the same stamp."""
    for sweep in sweeps:
        for piece in range(pieces):
            rows = slice(piece * len(sweep) // pieces, (piece + 1) * len(sweep) // pieces)
            yield sweep.keep(rows)


def print_digests(pieces: int, scenes: tuple[str, ...]) -> None:
    """Print versions and digests as JSON: the program of `determinism.run_digests`."""
    import numba  # for its version

    digests = {
        f"{scene}, {criterion}": digest(
            last_update(in_pieces(simulate(scene, duration=DURATION), pieces), criterion)
        )
        for scene in scenes
        for criterion in CRITERIA
    }
    python = ".".join(map(str, sys.version_info[:3]))
    versions = f"{python} with numpy {np.__version__}, numba {numba.__version__}"
    sys.stdout.write(json.dumps({"versions": versions, "digests": digests}))
