"""Clouds with truth from any source. Apart from Scan, since a process of a peer reads nothing."""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.errors import InputError
from ellipseg_ros.io.sources import SIMULATED, Source
from ellipseg_ros.records import Array, join_sweeps
from ellipseg_ros.simulation.shapes import Class
from studies.partition.metrics import UNKNOWN
from studies.partition.scan import Scan

CLASS_FIELDS = ("class", "coarse")  # of simulated scenes, of labelled scans: the same numbers
INSTANCE_FIELD = "instance"


def read_scan(source: Source, spec: str) -> Scan:
    """All points of a source as one cloud; InputError if it has no classes."""
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


class Truth(NamedTuple):
    """What the fields of n points say of them."""

    classes: Array  # (n,) int64, see Class; 0: not known
    instances: Array | None  # (n,) int64, 0: no thing; None: not told for every thing


def truth_of(fields: Array | None) -> Truth | None:
    """The truth in the fields (n,) of points; None if there are no classes."""
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
    things = (classes != UNKNOWN) & (classes != Class.GROUND)
    return instances if things.any() and (instances[things] != UNKNOWN).all() else None
