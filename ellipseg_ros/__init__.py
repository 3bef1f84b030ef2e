"""Ellipsoid segmentation of registered lidar streams, for ROS 2."""

from pkgutil import extend_path

# The generated ellipseg_ros.msg is with the installed package: find it from a checkout, too.
__path__ = extend_path(__path__, __name__)
