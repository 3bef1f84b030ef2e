"""Clouds with truth from any source. Apart from Scan, since a process of a peer reads nothing."""

import numpy as np

from ellipseg_ros.comparison.scan import Scan
from ellipseg_ros.data import Array, join_sweeps
from ellipseg_ros.errors import InputError
from ellipseg_ros.evaluation import UNKNOWN
from ellipseg_ros.io.sources import SIMULATED, Source
from ellipseg_ros.simulation.shapes import Class

CLASS_FIELDS = ("class", "coarse")  # of simulated scenes, of labelled scans: the same numbers
INSTANCE_FIELD = "instance"


def read_scan(source: Source, spec: str) -> Scan:
    """All points of a source as one cloud; InputError if it has no classes."""
    sweep = join_sweeps(list(source))
    names = (sweep.fields.dtype.names or ()) if sweep.fields is not None else ()
    field = next((name for name in CLASS_FIELDS if name in names), "")
    if sweep.fields is None or not field:
        raise InputError(
            f"{spec} has no classes; it must have a field {' or '.join(CLASS_FIELDS)}", "truth"
        )
    finite = np.isfinite(sweep.points).all(axis=1)
    classes = sweep.fields[field][finite].astype(np.int64)
    if not (classes != UNKNOWN).any():
        raise InputError(f"{spec} has no point of a known class; {field} is all 0", "truth")
    instances = None
    if INSTANCE_FIELD in names:
        instances = complete_instances(
            sweep.fields[INSTANCE_FIELD][finite].astype(np.int64), classes
        )
    simulated = spec.startswith(SIMULATED)
    return Scan(source.name, simulated, sweep.points[finite], classes, instances)


def complete_instances(instances: Array, classes: Array) -> Array | None:
    """The instances, if every point of a known class but the ground has one; else None."""
    things = (classes != UNKNOWN) & (classes != Class.GROUND)
    return instances if things.any() and (instances[things] != UNKNOWN).all() else None
