"""Reads labelled clouds from any source. Apart from Scan, which subprocesses need without it."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.core.fields import join_sweeps
from ellipseg_ros.errors import InputError
from ellipseg_ros.io.sources import SIMULATED, Source
from ellipseg_ros.records import Array
from ellipseg_ros.simulation.shapes import Class
from studies.partition.metrics import UNKNOWN
from studies.partition.scan import Scan

CLASS_FIELDS = ("class", "coarse")  # of simulated scenes and of labelled scans, equal numbers
INSTANCE_FIELD = "instance"


class Truth(NamedTuple):
    """True class and instance of n points."""

    classes: Array  # (n,) int64, see Class; 0: unknown
    instances: Array | None  # (n,) int64, 0: ground; None: not known for every point


def read_scan(source: Source, spec: str) -> Scan:
    """Join all points of a source into one cloud; InputError if it has no classes."""
    sweep = join_sweeps(list(source))
    finite = np.isfinite(sweep.points).all(axis=1)
    truth = truth_of(sweep.keep(finite).fields)
    if truth is None:
        raise InputError(
            f"{spec} has no classes; it must have a field {' or '.join(CLASS_FIELDS)}", "truth"
        )
    if not (truth.classes != UNKNOWN).any():
        raise InputError(f"{spec} has no point of a known class; they are all 0", "truth")
    simulated = spec.startswith(SIMULATED)
    return Scan(source.name, simulated, sweep.points[finite], truth.classes, truth.instances)


def truth_of(fields: Array | None) -> Truth | None:
    """The truth in the fields (n,) of points; None if they have no classes."""
    names = (fields.dtype.names or ()) if fields is not None else ()
    field = next((name for name in CLASS_FIELDS if name in names), "")
    if fields is None or not field:
        return None
    classes = fields[field].astype(np.int64)
    if INSTANCE_FIELD not in names:
        return Truth(classes, None)
    return Truth(classes, complete_instances(fields[INSTANCE_FIELD].astype(np.int64), classes))


def complete_instances(instances: Array, classes: Array) -> Array | None:
    """The instances, if every point of a known class but the ground has one; else None."""
    of_things = (classes != UNKNOWN) & (classes != Class.GROUND)
    complete = of_things.any() and (instances[of_things] != UNKNOWN).all()
    return instances if complete else None
