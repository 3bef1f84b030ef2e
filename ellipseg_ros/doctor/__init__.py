"""Checks of an installation, of the ROS environment and of a running graph: `ellipseg doctor`."""
