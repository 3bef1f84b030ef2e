"""Partition methods of other libraries on PyPI, with suitable parameters."""

from functools import cache
from importlib import import_module
from tempfile import TemporaryDirectory

import numpy as np

from ellipseg_ros.records import Array
from studies.partition.methods import CountParameter, Method, Run, Settings

GRAPH_NEIGHBOURS = 10  # of cut-pursuit
OUTDOOR_STRENGTH = 0.8  # regularisation of its authors for outdoor scans (Semantic3D)
MIN_POINTS = 12  # of a cluster


def prepare_cut_pursuit(points: Array) -> Run:
    """Minimal partition of geometric features, as for superpoint graphs.

    Guinard and Landrieu (2017), Weakly supervised segmentation-aided classification of urban
    scenes; Landrieu and Simonovsky (2018), Large-scale point cloud semantic segmentation with
    superpoint graphs: linearity, planarity, scattering and twice the verticality of the nearest
    neighbours; the 10-nearest-neighbour graph, weighted 1 / (1 + length / mean length).

    The package ignores its regularisation strength if weights are given (seen in 1.0.12), so the
    strength is a factor of the weights, which has the same meaning.
    """
    cut_pursuit = import_module("cut_pursuit_py").perform_cut_pursuit
    pgeof = import_module("pgeof")

    local = np.ascontiguousarray(points - points.mean(axis=0), dtype=np.float32)

    @cache
    def features(neighbours: int) -> tuple[Array, Array, Array]:
        count = min(neighbours + 1, len(local))
        near, squared = pgeof.knn_search(local, local, count)
        starts = np.arange(len(local) + 1, dtype=np.uint32) * np.uint32(count - 1)
        others = np.ascontiguousarray(near[:, 1:], dtype=np.uint32)
        geometric = pgeof.compute_features(local, others.reshape(-1), starts)[:, :4]
        return (
            others,
            np.sqrt(squared[:, 1:]),
            np.ascontiguousarray(geometric * [1, 1, 1, 2], "f4"),
        )

    def run(settings: Settings) -> Array:
        others, lengths, values = features(int(settings["neighbours"]))
        ends, length = others[:, :GRAPH_NEIGHBOURS], lengths[:, :GRAPH_NEIGHBOURS].reshape(-1)
        starts = np.repeat(np.arange(len(ends), dtype=np.uint32), ends.shape[1])
        weights = float(settings["strength"]) / (1.0 + length / max(float(length.mean()), 1e-9))
        labels = cut_pursuit(
            1.0,
            values.shape[1],
            values,
            weights.astype(np.float32),
            starts,
            np.ascontiguousarray(ends).reshape(-1),
            False,
        )
        return np.asarray(labels).astype(np.int64)

    return run


def prepare_dbscan(points: Array) -> Run:
    """Density-based clusters, Ester et al. (1996), A density-based algorithm."""
    open3d = import_module("open3d")

    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))

    def run(settings: Settings) -> Array:
        labels = cloud.cluster_dbscan(float(settings["radius"]), int(settings["points"]))
        return np.asarray(labels, dtype=np.int64)

    return run


def prepare_patches(points: Array) -> Run:
    """Araújo and Oliveira (2020), A robust statistics approach for plane detection.

    A point belongs to the patch whose box contains it; of several, to that of the nearest plane.
    """
    open3d = import_module("open3d")

    corners = open3d.utility.Vector3dVector(points)
    search = open3d.geometry.KDTreeSearchParamKNN(30)

    def run(settings: Settings) -> Array:
        cloud = open3d.geometry.PointCloud(corners)
        cloud.estimate_normals(search)
        boxes = cloud.detect_planar_patches(
            normal_variance_threshold_deg=float(settings["angle"]),
            coplanarity_deg=float(settings["coplanarity"]),
            min_num_points=int(settings["points"]),
            search_param=search,
        )
        labels = np.full(len(points), -1)
        nearest = np.full(len(points), np.inf)
        for number, box in enumerate(boxes):
            inside = np.asarray(box.get_point_indices_within_bounding_box(corners), np.int64)
            off = np.abs((points[inside] - box.center) @ box.R[:, 2])
            closer = off < nearest[inside]
            labels[inside[closer]] = number
            nearest[inside[closer]] = off[closer]
        return labels

    return run


def prepare_hdbscan(points: Array) -> Run:
    """Hierarchy of DBSCAN over all radii, cut for stable clusters, Campello et al. (2013)."""
    hdbscan = import_module("hdbscan")

    folder = TemporaryDirectory()  # cache of the steps before min_cluster_size matters

    def run(settings: Settings) -> Array:
        clusters = hdbscan.HDBSCAN(
            min_cluster_size=int(settings["points"]),
            min_samples=5,
            cluster_selection_method=str(settings["selection"]),
            core_dist_n_jobs=1,  # its worker processes would outlive the time limit
            memory=folder.name,
        )
        return np.asarray(clusters.fit(points).labels_, dtype=np.int64)

    return run


def _grid(settings: Settings, name: str, values: tuple[float | str, ...]) -> tuple[Settings, ...]:
    """The settings with each of the values."""
    return tuple(settings | {name: value} for value in values)


CUT_PURSUIT = Method(
    "cut-pursuit",
    prepare_cut_pursuit,
    _grid({"strength": OUTDOOR_STRENGTH}, "neighbours", (20, 45)),
    CountParameter("strength", 0.001, 1000.0),
    "cut-pursuit-py pgeof",
    "cut_pursuit_py pgeof",
)
PEERS = (
    CUT_PURSUIT,
    Method(
        "Open3D DBSCAN",
        prepare_dbscan,
        _grid({"radius": 0.3}, "points", (3, 6, 12)),
        CountParameter("radius", 0.03, 1.0),  # above, its list of neighbours fills the memory
        "open3d-cpu",
        "open3d",
    ),
    Method(
        "Open3D planar patches",
        prepare_patches,
        _grid({"coplanarity": 75.0, "points": MIN_POINTS}, "angle", (30.0, 60.0, 75.0)),
        CountParameter("points", 4, 10_000, integer=True),
        "open3d-cpu",
        "open3d",
    ),
    Method(
        "HDBSCAN",
        prepare_hdbscan,
        _grid({"points": MIN_POINTS}, "selection", ("eom", "leaf")),
        CountParameter("points", 2, 10_000, integer=True),
        "hdbscan",
        "hdbscan",
    ),
)
