"""Every setting, once: default, meaning, unit, limits.

The YAML file, the ROS parameters and the command line derive from it.
"""

from dataclasses import dataclass, field

from ellipseg_ros.errors import ConfigError
from ellipseg_ros.settings import Checked, setting

DEFAULT_THRESHOLD = -1.0  # as `threshold`: the default of the criterion


def criterion_names() -> tuple[str, ...]:
    """Names of the merge criteria."""
    # Only now: that module imports numba, which `ellipseg --help` can do without.
    from ellipseg_ros.core.criteria import CRITERIA

    return tuple(CRITERIA)


@dataclass(frozen=True)
class GraphConfig(Checked):
    """Which points are neighbours."""

    neighbours: int = setting(10, "nearest neighbours per point", low=3, high=64)
    isolation_distance: float = setting(
        2.0,
        "a point farther than this from its nearest neighbour is isolated",
        unit="m",
        low=0.001,
        high=1000.0,
    )


@dataclass(frozen=True)
class ModelConfig(Checked):
    """Constants of the merge criteria and of the AICc."""

    eigenvalue_floor: float = setting(
        1e-4,
        "lower bound of an eigenvalue that divides in the shape distance",
        unit="m^2",
        low=1e-12,
        high=1.0,
    )
    noise_variance: float = setting(
        0.01,
        "squared measurement noise: lower bound of an eigenvalue in the AICc",
        unit="m^2",
        low=1e-12,
        high=100.0,
    )


@dataclass(frozen=True)
class ObjectsConfig(Checked):
    """Grouping of segments into objects."""

    enabled: bool = setting(True, "group segments into objects at every update")
    scale: float = setting(
        1.0,
        "merge while the lowest cost, the growth of the squared deviations of the features per "
        "square root of the number of edges between two groups, is at most this",
        low=0.0,
        high=1e9,
    )
    thickness: float = setting(
        0.04,
        "segments whose union is flat to this standard deviation are one object at any scale",
        unit="m",
        low=0.0,
        high=10.0,
    )


@dataclass(frozen=True)
class LandmarksConfig(Checked):
    """Selection of landmarks."""

    enabled: bool = setting(True, "find landmarks at every update")
    min_points: int = setting(40, "minimum number of points of a landmark", low=10, high=1_000_000)
    roughness: float = setting(
        0.03,
        "maximum standard deviation of a landmark's points from its shape",
        unit="m",
        low=0.001,
        high=1.0,
    )
    max_angle: float = setting(
        0.7,
        "maximum standard deviation of a landmark's direction",
        unit="deg",
        low=0.01,
        high=45.0,
    )
    registration_noise: float = setting(
        0.02,
        "standard deviation of the registration error common to all points of a landmark",
        unit="m",
        low=0.0,
        high=10.0,
    )


@dataclass(frozen=True)
class Config(Checked):
    """Settings of the segmenter."""

    criterion: str = setting("shape", "merge criterion", allowed=criterion_names)
    threshold: float | None = setting(
        DEFAULT_THRESHOLD,
        "merge while the criterion is at most this (shape, parsimony: no unit; density: m); "
        "-1: the default of the criterion",
        low=-1.0,
        high=1e9,
    )
    window_duration: float = setting(
        25.0, "length of the sliding window", unit="s", low=0.01, high=86400.0
    )
    update_period: float = setting(
        1.0, "sensor time between two updates", unit="s", low=0.001, high=3600.0
    )
    max_lateness: float = setting(
        1.0,
        "a cloud up to this much older than the newest is accepted; an older one restarts the "
        "window",
        unit="s",
        low=0.0,
        high=3600.0,
    )
    max_points_per_second: int = setting(
        0,
        "thin denser input to about this rate; 0: no thinning",
        unit="1/s",
        low=0,
        high=1_000_000_000,
    )
    max_points: int = setting(
        2_000_000,
        "maximum number of points in the window, which bounds memory and time: the oldest points "
        "are evicted; 0: no limit",
        unit="points",
        low=0,
        high=1_000_000_000,
        live=False,  # so that no other participant of the network can lift the bound
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
        3.0,
        "maximum translation of the centroid of the later landmarks",
        unit="m",
        low=0.0,
        high=100.0,
    )
    max_rotation: float = setting(
        10.0, "maximum rotation about the centroid", unit="deg", low=0.0, high=45.0
    )
    noise: float = setting(
        0.02,
        "extra standard deviation between two observations of one landmark, beyond their "
        "covariances; lower bound of that of the transform, since drift bends a window",
        unit="m",
        low=1e-4,
        high=10.0,
    )
    angle_noise: float = setting(
        0.2,
        "extra standard deviation between two observations of one direction",
        unit="deg",
        low=1e-3,
        high=45.0,
    )
    size_ratio: float = setting(
        2.0,
        "maximum ratio of the thicknesses of two lines, and of the sizes of two blobs",
        low=1.0,
        high=1e3,
    )
    gap: float = setting(
        0.5,
        "maximum gap between the extents of two planes or lines",
        unit="m",
        low=0.0,
        high=100.0,
    )
    known: float = setting(
        0.05,
        "a direction of the transform is known if its standard deviation is at most this; of a "
        "rotation, at the distance of the landmarks from their centroid",
        unit="m",
        low=1e-4,
        high=100.0,
    )
    min_probability: float = setting(
        0.95, "minimum probability of a pair that is reported", low=0.0, high=1.0
    )


@dataclass(frozen=True)
class MapConfig(Checked):
    """Which landmarks are kept to be recognized later."""

    max_stability: float = setting(
        3.0,
        "a landmark enters the map if its last updates moved it by at most so many standard "
        "deviations",
        low=0.0,
        high=1e9,
    )
    min_age: float = setting(
        2.0, "and if it was a landmark for so long", unit="s", low=0.0, high=86400.0
    )
    delay: float = setting(
        30.0,
        "it can be recognized so long after it has expired: what has just left the window is "
        "no news",
        unit="s",
        low=0.0,
        high=86400.0,
    )
    max_landmarks: int = setting(20_000, "of more, the oldest are forgotten", low=1, high=500_000)


@dataclass(frozen=True)
class AssociatorConfig(Checked):
    """Where the associator keeps its map."""

    map_file: str = setting(
        "",
        "file that ~/save writes and ~/load reads, and that is read at the start if it is there; "
        "empty: none",
        live=False,
    )


@dataclass(frozen=True)
class NodeConfig(Checked):
    """How the node listens and what it shows."""

    input_reliability: str = setting(
        "auto",
        "reliability asked of publishers of `points`; auto: reliable, unless one of them is best "
        "effort; best_effort matches every publisher, but large clouds get lost",
        allowed=("auto", "best_effort", "reliable"),
        live=False,
    )
    input_depth: int = setting(
        100, "clouds that DDS keeps for the node", unit="clouds", low=1, high=100_000, live=False
    )
    max_backlog: int = setting(
        2,
        "updates that may wait before they are taken together; 0: never taken together",
        low=0,
        high=1000,
        live=False,  # likewise: without it anything may wait
    )
    full_segments_period: float = setting(
        0.0,
        "sensor time between two messages on `segments` that list everything, those between list "
        "changes; 0: all list everything",
        unit="s",
        low=0.0,
        high=86400.0,
    )
    auto_tune_period: float = setting(
        0.0,
        "sensor time between two tunings of the threshold by the node itself; 0: never",
        unit="s",
        low=0.0,
        high=86400.0,
    )
    marker_sigmas: float = setting(
        2.0, "half axes of a marker, in standard deviations", low=0.01, high=100.0
    )
    marker_colour: str = setting(
        "shape",
        "colour of a marker: of its shape, or of the object that it belongs to",
        allowed=("shape", "object"),
    )
    marker_min_count: int = setting(
        12, "segments with fewer points have no marker", unit="points", low=1, high=1_000_000
    )
