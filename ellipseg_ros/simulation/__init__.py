"""Simulated lidar drives with ground truth: shapes, rays, scanner and path, scenes."""
