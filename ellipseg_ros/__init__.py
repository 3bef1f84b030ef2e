"""Online segmentation of registered lidar streams into ellipsoids, for ROS 2.

The names below are the public interface. Everything else in the package is internal and may change
between versions. Each name is imported from its module on first use, so that `import ellipseg_ros`
loads neither numba nor numpy.
"""

from importlib import import_module
from pkgutil import extend_path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # the same names for mypy and editors
    from ellipseg_ros.association.associate import associate as associate
    from ellipseg_ros.association.associate import pair_residual as pair_residual
    from ellipseg_ros.association.landmark_map import LandmarkMap as LandmarkMap
    from ellipseg_ros.association.landmark_map import StoredMap as StoredMap
    from ellipseg_ros.association.landmark_map import (
        concatenate_landmarks as concatenate_landmarks,
    )
    from ellipseg_ros.association.landmark_map import no_landmarks as no_landmarks
    from ellipseg_ros.association.landmark_map import select_landmarks as select_landmarks
    from ellipseg_ros.config import AssociationConfig as AssociationConfig
    from ellipseg_ros.config import Config as Config
    from ellipseg_ros.config import MapConfig as MapConfig
    from ellipseg_ros.errors import ConfigError as ConfigError
    from ellipseg_ros.errors import EllipsegError as EllipsegError
    from ellipseg_ros.errors import InputError as InputError
    from ellipseg_ros.io.map_file import read_map as read_map
    from ellipseg_ros.io.map_file import write_map as write_map
    from ellipseg_ros.io.segment_mirror import SegmentMirror as SegmentMirror
    from ellipseg_ros.io.sources import open_source as open_source
    from ellipseg_ros.records import Association as Association
    from ellipseg_ros.records import Ellipsoids as Ellipsoids
    from ellipseg_ros.records import Kind as Kind
    from ellipseg_ros.records import Landmarks as Landmarks
    from ellipseg_ros.records import Objects as Objects
    from ellipseg_ros.records import Segmentation as Segmentation
    from ellipseg_ros.records import State as State
    from ellipseg_ros.records import Sweep as Sweep
    from ellipseg_ros.records import Verdict as Verdict
    from ellipseg_ros.segmenter import Segmenter as Segmenter
    from ellipseg_ros.segmenter import segment as segment
    from ellipseg_ros.tuning.search import tune as tune

# The generated ellipseg_ros.msg is in the installed package: find it from a checkout, too.
__path__ = extend_path(__path__, __name__)

# Module of the package -> public names that it defines.
_NAMES = {
    "association.associate": "associate pair_residual",
    "association.landmark_map": (
        "LandmarkMap StoredMap concatenate_landmarks no_landmarks select_landmarks"
    ),
    "config": "AssociationConfig Config MapConfig",
    "errors": "ConfigError EllipsegError InputError",
    "io.map_file": "read_map write_map",
    "io.segment_mirror": "SegmentMirror",
    "io.sources": "open_source",
    "records": "Association Ellipsoids Kind Landmarks Objects Segmentation State Sweep Verdict",
    "segmenter": "Segmenter segment",
    "tuning.search": "tune",
}
_MODULES = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = list(_MODULES)


def __getattr__(name: str) -> Any:
    """Import a public name from its module."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = value  # __getattr__ is not called for this name again
    return value


def __dir__() -> list[str]:
    """List the public names and the modules that have been imported."""
    return sorted({*globals(), *__all__})
