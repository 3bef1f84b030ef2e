"""Random records, for tests of code that converts or stores them."""

import numpy as np
from scipy.spatial.transform import Rotation

from ellipseg_ros.records import (
    THINNED,
    Ellipsoids,
    Hierarchy,
    Kind,
    Landmarks,
    Objects,
    Ragged,
    Segmentation,
    State,
    Sweep,
)


def ellipsoids(count, rng):
    """(s,) random ellipsoids with `count` (s,) points; the first two are degenerate."""
    s = len(count)
    eigenvalues = -np.sort(-rng.exponential(size=(s, 3)), axis=1)
    eigenvalues[:1] = 0.0
    eigenvalues[1:2, 1:] = 0.0
    total = np.where(eigenvalues.sum(axis=1) > 0, eigenvalues.sum(axis=1), 1.0)
    planarity = 2 * (eigenvalues[:, 1] - eigenvalues[:, 2]) / total
    cylindricality = (eigenvalues[:, 0] - eigenvalues[:, 1]) / total
    axes = Rotation.random(s, rng=rng).as_matrix() if s else np.zeros((0, 3, 3))
    mean = rng.normal(scale=50.0, size=(s, 3))
    covariance = np.einsum("sij,sj,skj->sik", axes, eigenvalues, axes)
    return Ellipsoids(
        count=np.asarray(count, np.int64),
        mean=mean,
        covariance=covariance,
        eigenvalues=eigenvalues,
        axes=axes,
        planarity=planarity,
        cylindricality=cylindricality,
        sphericity=1.0 - planarity - cylindricality,
        aicc=rng.normal(size=s),
        model_mean=mean,
        model_covariance=covariance,
    )


def parents(count, rng):
    """Random parent ids for `count` segments or objects, up to three each."""
    lengths = rng.integers(0, 4, count)
    values = rng.integers(1, 99, lengths.sum()).astype(np.uint32)
    return Ragged(np.append(0, np.cumsum(lengths)), values)


def objects(labels, of_segment, rng):
    """Random objects; labels (n,) of the points, of_segment (s,) the object of every segment."""
    o = int(of_segment.max(initial=-1)) + 1
    count = np.bincount(of_segment[labels[labels >= 0]], minlength=o) if o else np.zeros(0, int)
    shape = ellipsoids(count, rng)
    size = rng.exponential(size=(o, 3))
    return Objects(
        segment_labels=of_segment,
        count=shape.count,
        mean=shape.mean,
        covariance=shape.covariance,
        box_min=shape.mean - size,
        box_max=shape.mean + size,
        planarity=shape.planarity,
        cylindricality=shape.cylindricality,
        sphericity=shape.sphericity,
        hierarchy=Hierarchy(*(np.zeros(0, kind) for kind in "iid"), len(of_segment)),
        ids=rng.permutation(np.arange(1, o + 1)).astype(np.uint32),
        state=rng.integers(0, len(State), o).astype(np.uint8),
        parents=parents(o, rng),
    )


def landmarks(labels, rng, end_ns, count=7):
    """Random landmarks, each made of random points."""
    point_labels = np.where(labels >= 0, rng.integers(-1, count, len(labels)), -1).astype(np.int32)
    rows = [np.unique(labels[point_labels == row]) for row in range(count)]
    covariance = rng.normal(size=(count, 6, 6))
    return Landmarks(
        ids=np.sort(rng.choice(99, count, replace=False) + 1).astype(np.uint32),
        kind=rng.integers(0, len(Kind), count).astype(np.uint8),
        count=rng.integers(40, 500, count),
        position=rng.normal(scale=20.0, size=(count, 3)),
        axes=Rotation.random(count, random_state=5).as_matrix(),
        sigma=np.sort(rng.uniform(0.01, 3.0, (count, 3)))[:, ::-1],
        box_min=rng.uniform(-3.0, -1.0, (count, 3)),
        box_max=rng.uniform(1.0, 3.0, (count, 3)),
        covariance=covariance @ covariance.transpose(0, 2, 1),
        instability=rng.uniform(0.0, 2.0, count),
        first_seen_ns=end_ns - rng.integers(0, 10**11, count),
        segments=Ragged(np.append(0, np.cumsum([len(r) for r in rows])), np.concatenate(rows)),
        point_labels=point_labels,
        removed=np.array([100, 107], np.uint32),
    )


def segmentation(points=400, segments=20, seed=0, **changes):
    """A window of random points with random labels; `changes` replace fields of it."""
    rng = np.random.default_rng(seed)
    labels = rng.integers(-3, segments, points).astype(np.int32)
    labels[labels == -3] = THINNED
    count = np.bincount(labels[labels >= 0], minlength=segments)
    _, of_segment = np.unique(rng.integers(0, 1 + segments // 3, segments), return_inverse=True)
    end_ns = 1_700_000_000_123_456_789
    values = {
        "labels": labels,
        "ellipsoids": ellipsoids(count, rng),
        "aicc": -123.5,
        "criterion": "shape",
        "threshold": 3.5,
        "origin": np.zeros(3),
        "points": rng.normal(scale=50.0, size=(points, 3)).astype(np.float32).astype(np.float64),
        "arrival": np.arange(points),
        "times_ns": end_ns - rng.integers(0, 25_000_000_000, points),
        "fields": None,
        "frame_id": "odom",
        "ids": rng.permutation(np.arange(1, segments + 1)).astype(np.uint32),
        "state": rng.integers(0, len(State), segments).astype(np.uint8),
        "parents": parents(segments, rng),
        "removed": np.array([77, 78], np.uint32),
        "objects": objects(labels, of_segment.astype(np.int32), rng),
        "removed_objects": np.array([5, 55], np.uint32),
        "adjacency": None,
        "landmarks": landmarks(labels, rng, end_ns),
        "first_seen_ns": end_ns - rng.integers(10**10, 2 * 10**10, segments),
        "last_seen_ns": end_ns - rng.integers(0, 10**10, segments),
        "start_ns": end_ns - 25_000_000_000,
        "end_ns": end_ns,
        "late": 3,
        "evicted": 5,
        "filtered": 4,
        "unplaced": 7,
        "sequence": 0,
        "restart": "",
        "threshold_change": "tuned",
    }
    values |= {
        "hits": np.ones(len(labels), np.int64),
        "means": values["points"],
        "sweep": Sweep(end_ns, values["points"]),
        "sweep_rows": np.arange(len(labels)),
    }
    return Segmentation(**(values | changes))
