"""Other libraries: neighbour searches and clusterings in common use."""

from collections.abc import Callable
from typing import Any, NamedTuple

from ellipseg_ros.records import Array

THREADS = 2
NEIGHBOURS = 10
RADIUS = 0.3  # m, of DBSCAN
MIN_POINTS = 12  # of a cluster


class Peer(NamedTuple):
    """An operation of another library."""

    name: str
    package: str  # on PyPI
    module: str
    about: str
    prepare: Callable[[Any, Array], Callable[[], Any]]  # (module, points) -> the timed call


def _scipy(module: Any, points: Array) -> Callable[[], Any]:
    return lambda: module.cKDTree(points).query(points, NEIGHBOURS, workers=THREADS)


def _small_gicp(module: Any, points: Array) -> Callable[[], Any]:
    def search() -> Any:
        tree = module.KdTree(points, num_threads=THREADS)
        return tree.batch_knn_search(points, NEIGHBOURS, num_threads=THREADS)

    return search


def _open3d_dbscan(module: Any, points: Array) -> Callable[[], Any]:
    cloud = _open3d_cloud(module, points)
    return lambda: cloud.cluster_dbscan(RADIUS, MIN_POINTS)


def _open3d_covariances(module: Any, points: Array) -> Callable[[], Any]:
    cloud = _open3d_cloud(module, points)
    search = module.geometry.KDTreeSearchParamKNN(NEIGHBOURS)
    return lambda: cloud.estimate_covariances(search)


def _open3d_cloud(module: Any, points: Array) -> Any:
    return module.geometry.PointCloud(module.utility.Vector3dVector(points))


def _hdbscan(module: Any, points: Array) -> Callable[[], Any]:
    return lambda: module.HDBSCAN(min_cluster_size=MIN_POINTS, core_dist_n_jobs=THREADS).fit(
        points
    )


KNN = Peer(
    "small_gicp 10-NN",
    "small_gicp",
    "small_gicp",
    f"kd-tree, build and query, {THREADS} threads",
    _small_gicp,
)
PEERS = (
    KNN,
    Peer(
        "scipy cKDTree 10-NN",
        "scipy",
        "scipy.spatial",
        f"build and query, {THREADS} threads",
        _scipy,
    ),
    Peer(
        "Open3D covariances",
        "open3d-cpu",
        "open3d",
        "10-NN and covariance of every point, all threads",
        _open3d_covariances,
    ),
    Peer(
        "Open3D DBSCAN",
        "open3d-cpu",
        "open3d",
        f"radius {RADIUS} m, {MIN_POINTS} points, one thread",
        _open3d_dbscan,
    ),
    Peer(
        "HDBSCAN",
        "hdbscan",
        "hdbscan",
        f"min_cluster_size {MIN_POINTS}, {THREADS} threads",
        _hdbscan,
    ),
)
