"""Poses of the sensor: series in time, transform tree, and the placement of clouds by them."""
