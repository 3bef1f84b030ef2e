"""Every setting, once: default, meaning, unit, limits.

The YAML file, the ROS parameters and the command line derive from it.
"""

import numbers
from collections.abc import Callable, Iterator
from dataclasses import Field, dataclass, field, fields, is_dataclass, replace
from typing import Any, TypeVar

from ellipseg_ros.errors import ConfigError

T = TypeVar("T")
Value = bool | int | float | str

DEFAULT_THRESHOLD = -1.0  # as `threshold`: the default of the criterion


def criterion_names() -> tuple[str, ...]:
    """Names of the merge criteria."""
    # Only now: that module imports numba, which `ellipseg --help` can do without.
    from ellipseg_ros.core.criteria import CRITERIA

    return tuple(CRITERIA)


@dataclass(frozen=True)
class Setting:
    """Meaning and limits of one setting: the metadata of a field."""

    about: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    allowed: tuple[str, ...] | Callable[[], tuple[str, ...]] = ()
    live: bool = True  # may change while the node runs

    @property
    def choices(self) -> tuple[str, ...]:
        """The values that are allowed; empty: all within the limits."""
        return self.allowed() if callable(self.allowed) else self.allowed


def setting(default: Any, about: str, **limits: Any) -> Any:
    """A dataclass field with meaning, unit and limits (see Setting)."""
    return field(default=default, metadata={"setting": Setting(about, **limits)})


@dataclass(frozen=True)
class Checked:
    """A record of settings that refuses values of a wrong type or out of range."""

    def __post_init__(self) -> None:
        for item in fields(self):
            if "setting" in item.metadata:
                value = checked(item, getattr(self, item.name))
                object.__setattr__(self, item.name, value)
            elif not isinstance(getattr(self, item.name), Checked):
                kind = item.default_factory.__name__  # type: ignore[union-attr]  # nested records
                raise ConfigError(
                    f"{item.name} is {getattr(self, item.name)!r}; it must be a {kind}"
                )


def checked(item: Field[Any], value: Any) -> Any:
    """Return `value` as the field's type, or raise ConfigError in one line."""
    limits: Setting = item.metadata["setting"]
    kind: Any = type(item.default)
    number = as_kind(kind, value)
    if number is None:
        raise ConfigError(
            f"{item.name} is {value!r}, of type {type(value).__name__}; it must be {kind.__name__}"
        )
    if limits.choices and number not in limits.choices:
        raise ConfigError(
            f"{item.name} is {value!r}; it must be one of {', '.join(limits.choices)}"
        )
    low, high = limits.low, limits.high
    if low is not None and high is not None and not low <= number <= high:
        span = f"from {low:g} to {high:g} {limits.unit}".rstrip()
        raise ConfigError(f"{item.name} is {value:g}; it must be {span}")
    return number


def as_kind(kind: Any, value: Any) -> Any:
    """`value` as `kind`, if only a numpy type or an integer's width changes; else None."""
    if isinstance(value, bool) or kind not in (int, float):
        return value if type(value) is kind else None
    wider = numbers.Integral if kind is int else numbers.Real
    return kind(value) if isinstance(value, wider) else None


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
        "least variance that divides in the shape distance",
        unit="m^2",
        low=1e-12,
        high=1.0,
    )
    noise_variance: float = setting(
        0.01,
        "squared measurement noise: least variance of a segment in the AICc",
        unit="m^2",
        low=1e-12,
        high=100.0,
    )


@dataclass(frozen=True)
class ObjectsConfig(Checked):
    """How segments become objects."""

    enabled: bool = setting(True, "group segments into objects, at every update")
    scale: float = setting(
        1.0,
        "merge while the least cost, the growth of the squared deviations of the features "
        "per square root of the boundary's edges, is at most this",
        low=0.0,
        high=1e9,
    )
    thickness: float = setting(
        0.04,
        "what is flat together to this standard deviation is one object at any scale",
        unit="m",
        low=0.0,
        high=10.0,
    )


@dataclass(frozen=True)
class LandmarksConfig(Checked):
    """What of the scene is a landmark."""

    enabled: bool = setting(True, "look for landmarks, at every update")
    min_points: int = setting(40, "a landmark has at least so many points", low=10, high=1_000_000)
    roughness: float = setting(
        0.03,
        "standard deviation of a landmark's points from its shape, at most",
        unit="m",
        low=0.001,
        high=1.0,
    )
    max_angle: float = setting(
        0.7,
        "standard deviation of a landmark's direction, at most",
        unit="deg",
        low=0.01,
        high=45.0,
    )
    registration_noise: float = setting(
        0.02,
        "error of the registration that all points of a landmark have in common",
        unit="m",
        low=0.0,
        high=10.0,
    )


@dataclass(frozen=True)
class Config(Checked):
    """How points become segments, and segments objects."""

    criterion: str = setting(
        "shape", "what decides whether two segments merge", allowed=criterion_names
    )
    threshold: float | None = setting(
        DEFAULT_THRESHOLD,
        "merge while the criterion is at most this (shape, parsimony: no unit; density: m); "
        "-1: the criterion's own default",
        low=-1.0,
        high=1e9,
    )
    window_duration: float = setting(
        25.0, "length of the window of points", unit="s", low=0.01, high=86400.0
    )
    update_period: float = setting(
        1.0, "sensor time between two updates", unit="s", low=0.001, high=3600.0
    )
    max_lateness: float = setting(
        1.0,
        "a cloud this much older than the newest is accepted; an older one is a jump back: reset",
        unit="s",
        low=0.0,
        high=3600.0,
    )
    max_points_per_second: int = setting(
        0,
        "thin denser input to about this rate; 0: keep all",
        unit="1/s",
        low=0,
        high=1_000_000_000,
    )
    max_points: int = setting(
        2_000_000,
        "points that a window holds at most, which bounds memory and time: the oldest expire "
        "early; 0: no limit",
        unit="points",
        low=0,
        high=1_000_000_000,
        live=False,  # nobody in the same network can lift the bound
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
        """The threshold in force: the given one, or the criterion's own default."""
        if self.threshold is None or self.threshold == DEFAULT_THRESHOLD:
            from ellipseg_ros.core.criteria import CRITERIA  # see criterion_names

            return CRITERIA[self.criterion].default_threshold
        return self.threshold


@dataclass(frozen=True)
class AssociationConfig(Checked):
    """How two sets of landmarks are compared."""

    max_translation: float = setting(
        3.0,
        "the centroid of the later landmarks moves at most this",
        unit="m",
        low=0.0,
        high=100.0,
    )
    max_rotation: float = setting(
        10.0, "they turn at most this about it", unit="deg", low=0.0, high=45.0
    )
    noise: float = setting(
        0.02,
        "two looks at one thing differ by this beyond what their covariances say; and the "
        "transform is no surer, for the drift within a window bends it",
        unit="m",
        low=1e-4,
        high=10.0,
    )
    angle_noise: float = setting(
        0.2,
        "two looks at one direction differ by this beyond what their covariances say",
        unit="deg",
        low=1e-3,
        high=45.0,
    )
    size_ratio: float = setting(
        2.0,
        "thickness of lines and size of blobs differ at most by this factor",
        low=1.0,
        high=1e3,
    )
    gap: float = setting(
        0.5,
        "extents along a plane or a line are at most this far apart",
        unit="m",
        low=0.0,
        high=100.0,
    )
    known: float = setting(
        0.05,
        "a direction is known if its standard deviation is at most this; "
        "a rotation's at the distance of the landmarks from their centroid",
        unit="m",
        low=1e-4,
        high=100.0,
    )
    min_probability: float = setting(
        0.95, "pairs that are right with less probability are not given", low=0.0, high=1.0
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


def flatten(config: Checked, prefix: str = "") -> dict[str, Value]:
    """Settings by dotted name: {"graph.neighbours": 10, ...}, in the order of the classes."""
    return {name: value for name, value, _ in walk(config, prefix)}


def walk(config: Checked, prefix: str = "") -> Iterator[tuple[str, Value, Setting]]:
    """Yield (dotted name, value, meaning and limits) of every setting."""
    for item in fields(config):
        value = getattr(config, item.name)
        if is_dataclass(value):
            yield from walk(value, f"{prefix}{item.name}.")  # type: ignore[arg-type]  # Checked by design
        else:
            yield prefix + item.name, value, item.metadata["setting"]


def with_values(config: T, values: dict[str, Any]) -> T:
    """Copy of `config` with settings by dotted name changed; ConfigError for an unknown name."""
    known = {item.name: getattr(config, item.name) for item in fields(config)}  # type: ignore[arg-type]  # dataclass
    changes: dict[str, Any] = {}
    nested: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        head, _, rest = name.partition(".")
        if head not in known or bool(rest) != is_dataclass(known[head]):
            names = ", ".join(flatten(config))  # type: ignore[arg-type]  # only Checked records come here
            raise ConfigError(f"there is no setting {name}; there are {names}")
        if rest:
            nested.setdefault(head, {})[rest] = value
        else:
            changes[head] = value
    for head, inner in nested.items():
        changes[head] = with_values(known[head], inner)
    return replace(config, **changes)  # type: ignore[type-var]  # dataclass
