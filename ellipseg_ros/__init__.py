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

# Public name -> module of the package that defines it.
_MODULES = {
    "Association": "records",
    "AssociationConfig": "config",
    "Config": "config",
    "ConfigError": "errors",
    "EllipsegError": "errors",
    "Ellipsoids": "records",
    "InputError": "errors",
    "Kind": "records",
    "LandmarkMap": "association.landmark_map",
    "Landmarks": "records",
    "MapConfig": "config",
    "Objects": "records",
    "SegmentMirror": "io.segment_mirror",
    "Segmentation": "records",
    "Segmenter": "segmenter",
    "State": "records",
    "StoredMap": "association.landmark_map",
    "Sweep": "records",
    "Verdict": "records",
    "associate": "association.associate",
    "concatenate_landmarks": "association.landmark_map",
    "no_landmarks": "association.landmark_map",
    "open_source": "io.sources",
    "pair_residual": "association.associate",
    "read_map": "io.map_file",
    "segment": "segmenter",
    "select_landmarks": "association.landmark_map",
    "tune": "tuning.search",
    "write_map": "io.map_file",
}

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
