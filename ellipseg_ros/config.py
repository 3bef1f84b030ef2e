"""Every setting, once: default, meaning, unit, limits.

The YAML file, the ROS parameters and the command line derive from it.
"""

import math
import operator
from dataclasses import dataclass, field

from ellipseg_ros.errors import ConfigError
from ellipseg_ros.settings import Checked, setting

MAX_NORM_ERROR = 0.01  # of a quaternion; senders that round to two digits stay below
DEFAULT_THRESHOLD = -1.0  # as `threshold`: the default of the criterion


def criterion_names() -> tuple[str, ...]:
    """Names of the merge criteria."""
    # Only now: that module imports numba, which `ellipseg --help` can do without.
    from ellipseg_ros.core.criteria import CRITERIA

    return tuple(CRITERIA)


@dataclass(frozen=True)
class GraphConfig(Checked):
    """Which points are neighbours."""

    neighbours: int = setting(10, "nearest neighbours per point", "", 3, 64)
    isolation_distance: float = setting(
        2.0, "a point farther than this from its nearest neighbour is isolated", "m", 0.001, 1000.0
    )


@dataclass(frozen=True)
class ModelConfig(Checked):
    """Constants of the merge criteria and of the AICc."""

    eigenvalue_floor: float = setting(
        1e-4, "lower bound of an eigenvalue that divides in the shape distance", "m^2", 1e-12, 1.0
    )
    noise_variance: float = setting(
        0.01,
        "squared measurement noise: lower bound of eigenvalues in the AICc",
        "m^2",
        1e-12,
        100.0,
    )


@dataclass(frozen=True)
class ObjectsConfig(Checked):
    """Grouping of segments into objects."""

    enabled: bool = setting(True, "group segments into objects at every update")
    scale: float = setting(
        1.0,
        "merge while the lowest cost, the growth of the squared deviations of the features per "
        "square root of the number of edges between two groups, is at most this",
        "",
        0.0,
        1e9,
    )
    thickness: float = setting(
        0.04,
        "segments with a union as flat as this are one object at any scale",
        "m",
        0.0,
        10.0,
    )


@dataclass(frozen=True)
class LandmarksConfig(Checked):
    """Selection of landmarks."""

    enabled: bool = setting(True, "find landmarks at every update")
    min_points: int = setting(40, "minimum number of points of a landmark", "", 10, 1_000_000)
    roughness: float = setting(
        0.03, "maximum standard deviation of a landmark's points from its shape", "m", 0.001, 1.0
    )
    max_angle: float = setting(
        0.7, "maximum standard deviation of a landmark's direction", "deg", 0.01, 45.0
    )
    registration_noise: float = setting(
        0.02,
        "registration error (sigma) common to all points of a landmark",
        "m",
        0.0,
        10.0,
    )


@dataclass(frozen=True)
class Config(Checked):
    """Settings of the segmenter."""

    criterion: str = setting("shape", "merge criterion", allowed=criterion_names)
    threshold: float | None = setting(
        DEFAULT_THRESHOLD,
        "merge while the criterion is at most this (shape, parsimony: no unit; density: m); "
        "-1: the default of the criterion",
        "",
        -1.0,
        1e9,
    )
    window_duration: float = setting(25.0, "length of the sliding window", "s", 0.01, 86400.0)
    update_period: float = setting(1.0, "sensor time between two updates", "s", 0.001, 3600.0)
    max_lateness: float = setting(
        1.0,
        "age, against the newest cloud, up to which a cloud does not restart the window",
        "s",
        0.0,
        3600.0,
    )
    resolution: float = setting(
        0.0,
        "edge of the cells in which one point represents all others; 0: every point is kept",
        "m",
        0.0,
        10.0,
        live=False,
    )
    resolution_range: float = setting(
        10.0,
        "range up to which cells have this edge; it doubles with every doubling of the range, up "
        "to three times",
        "m",
        0.1,
        1e4,
        live=False,
    )
    max_points_per_second: int = setting(
        0, "thin denser input to about this rate; 0: no thinning", "1/s", 0, 1_000_000_000
    )
    max_points: int = setting(
        2_000_000,
        "points in the window beyond which the oldest are evicted; 0: no limit",
        "points",
        0,
        1_000_000_000,
        live=False,
    )
    graph: GraphConfig = field(default_factory=GraphConfig)
    model: ModelConfig = field(default_factory=ModelConfig)
    objects: ObjectsConfig = field(default_factory=ObjectsConfig)
    landmarks: LandmarksConfig = field(default_factory=LandmarksConfig)

    def __post_init__(self) -> None:
        if self.threshold is None:
            object.__setattr__(self, "threshold", DEFAULT_THRESHOLD)
        super().__post_init__()
        if self.threshold is not None and DEFAULT_THRESHOLD < self.threshold < 0.0:
            raise ConfigError(
                f"threshold is {self.threshold:g}; it must be 0 or more, or -1 for the default"
            )

    @property
    def tau(self) -> float:
        """The threshold in force: the given one, or the default of the criterion."""
        if self.threshold is None or self.threshold == DEFAULT_THRESHOLD:
            from ellipseg_ros.core.criteria import CRITERIA  # see criterion_names

            return CRITERIA[self.criterion].default_threshold
        return self.threshold


@dataclass(frozen=True)
class AssociationConfig(Checked):
    """Association of two sets of landmarks."""

    max_translation: float = setting(
        3.0, "maximum translation of the centroid of the later landmarks", "m", 0.0, 100.0
    )
    max_rotation: float = setting(10.0, "maximum rotation about the centroid", "deg", 0.0, 45.0)
    noise: float = setting(
        0.02,
        "extra standard deviation between two observations of one landmark, beyond their "
        "covariances; lower bound of that of the transform, since drift bends a window",
        "m",
        1e-4,
        10.0,
    )
    angle_noise: float = setting(
        0.2,
        "extra standard deviation between two observations of a direction",
        "deg",
        1e-3,
        45.0,
    )
    size_ratio: float = setting(
        2.0,
        "maximum ratio of the thicknesses of lines, and of the sizes of blobs",
        "",
        1.0,
        1e3,
    )
    gap: float = setting(
        0.5, "maximum gap between the extents of two planes or lines", "m", 0.0, 100.0
    )
    known: float = setting(
        0.05,
        "a direction of the transform is known if its standard deviation is at most this; of a "
        "rotation, at the distance of the landmarks from their centroid",
        "m",
        1e-4,
        100.0,
    )
    min_probability: float = setting(
        0.95, "minimum probability of a pair that is reported", "", 0.0, 1.0
    )


@dataclass(frozen=True)
class MapConfig(Checked):
    """Selection of landmarks for the map."""

    max_instability: float = setting(
        3.0,
        "a landmark enters the map if it is at most this unstable, in standard deviations",
        "",
        0.0,
        1e9,
    )
    min_age: float = setting(2.0, "and if it has been a landmark for this time", "s", 0.0, 86400.0)
    delay: float = setting(
        30.0,
        "time from its expiry until it can be recognized",
        "s",
        0.0,
        86400.0,
    )
    max_landmarks: int = setting(
        20_000, "beyond this number the oldest are removed from the map", "", 1, 500_000
    )


@dataclass(frozen=True)
class AssociatorConfig(Checked):
    """File of the map."""

    map_file: str = setting(
        "",
        "file that ~/save writes, and that ~/load and the start read; empty: none",
        live=False,
    )


@dataclass(frozen=True)
class PlacementConfig(Checked):
    """Placement of clouds in a sensor's frame by poses."""

    pose_source: str = setting(
        "auto",
        "source of the poses of clouds; registered: the clouds are in a fixed frame already; "
        "auto: tf if fixed_frame is set, odometry if that topic is remapped, else registered",
        allowed=("auto", "registered", "odometry", "tf"),
        live=False,
    )
    fixed_frame: str = setting(
        "", "frame of tf in which the window lives, such as odom or map", live=False
    )
    extrinsic: str = setting(
        "",
        "pose of the lidar in the odometry's child frame, x y z qx qy qz qw [m]; for several "
        "lidars each after its frame_id: `front: 1 0 2 0 0 0 1; rear: -1 0 2 0 0 1 0`; "
        "empty: from the names of the frames, and static transforms",
        live=False,
    )
    odometry_stamp: str = setting(
        "exact",
        "what the stamp of an odometry is; exact: the time of its pose; scan_begin, scan_end: the "
        "begin or end of a scan, while the pose is that of its end",
        allowed=("exact", "scan_begin", "scan_end"),
        live=False,
    )
    odometry_offset: float = setting(
        0.0, "time to add to the stamps of the odometry", "s", -10.0, 10.0, live=False
    )
    odometry_jump: float = setting(
        1.0,
        "deviation from a steady motion between two poses that restarts the window; 0: none does",
        "m",
        0.0,
        1e6,
        live=False,
    )
    max_pose_gap: float = setting(
        1.0,
        "time between two poses up to which they are interpolated",
        "s",
        0.001,
        60.0,
        live=False,
    )
    deskew: str = setting(
        "auto",
        "move every point by the pose at its own time; auto: if the cloud has times of points; "
        "off: for clouds that are corrected already",
        allowed=("auto", "on", "off"),
        live=False,
    )
    time_field: str = setting(
        "", "field with the times of points; empty: the first with a known name", live=False
    )
    time_unit: str = setting(
        "auto",
        "unit of that field; auto: by its type and values",
        allowed=("auto", "s", "ms", "us", "ns"),
        live=False,
    )
    min_range: float = setting(
        0.1, "returns nearer to the sensor are filtered", "m", 0.0, 1e6, live=False
    )
    max_range: float = setting(
        0.0, "returns farther from the sensor are filtered; 0: none is", "m", 0.0, 1e6, live=False
    )
    self_filter: str = setting(
        "",
        "box in the sensor's frame, in which returns are filtered: "
        "x_min y_min z_min x_max y_max z_max [m]; empty: none",
        live=False,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.self_filter and not all(map(operator.lt, *self.self_box)):
            raise ConfigError(
                f"self_filter is {self.self_filter!r}; each min must be below its max"
            )
        for numbers in self.extrinsics.values():
            norm = math.sqrt(sum(x * x for x in numbers[3:]))
            if abs(norm - 1.0) > MAX_NORM_ERROR:
                raise ConfigError(f"the quaternion of extrinsic has norm {norm:g}; it must be 1")

    @property
    def self_box(self) -> tuple[list[float], list[float]]:
        """Corners of `self_filter`, m; without one that of an empty box."""
        if not self.self_filter:
            return [math.inf] * 3, [-math.inf] * 3
        numbers = _numbers("self_filter", self.self_filter, 6)
        return numbers[:3], numbers[3:]

    @property
    def extrinsics(self) -> dict[str, list[float]]:
        """Position (3) m and quaternion x, y, z, w of the lidar by frame_id; "": of any frame."""
        entries = [entry.rpartition(":") for entry in self.extrinsic.split(";") if entry.strip()]
        return {name.strip(): _numbers("extrinsic", text, 7) for name, _, text in entries}


def _numbers(name: str, text: str, count: int) -> list[float]:
    """`count` finite numbers from a text; ConfigError if there are others."""
    try:
        numbers = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise ConfigError(f"{name} is {text.strip()!r}; it must be {count} numbers")
    return numbers


@dataclass(frozen=True)
class NodeConfig(Checked):
    """Input, backlog and outputs of the node."""

    input_reliability: str = setting(
        "auto",
        "QoS of `points`; auto: reliable unless a publisher is best effort; best_effort matches "
        "every publisher, but loses large clouds",
        allowed=("auto", "best_effort", "reliable"),
        live=False,
    )
    input_depth: int = setting(
        100, "depth of the QoS of `points`", "clouds", 1, 100_000, live=False
    )
    max_backlog: int = setting(
        2,
        "waiting updates beyond which they are coalesced; 0: never",
        "",
        0,
        1000,
        live=False,
    )
    full_segments_period: float = setting(
        0.0,
        "sensor time between full messages on `segments`, others list changes; 0: all are full",
        "s",
        0.0,
        86400.0,
    )
    auto_tune_period: float = setting(
        0.0,
        "sensor time between two automatic tunings of the threshold; 0: never",
        "s",
        0.0,
        86400.0,
    )
    marker_sigmas: float = setting(
        2.0, "half axes of a marker, in standard deviations", "", 0.01, 100.0
    )
    marker_colour: str = setting(
        "shape",
        "colour of a marker: by its shape, or by its object",
        allowed=("shape", "object"),
    )
    marker_min_count: int = setting(
        12, "minimum number of points of a segment with a marker", "points", 1, 1_000_000
    )
