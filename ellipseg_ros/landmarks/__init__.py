"""Landmarks: planes, lines and blobs that can be observed again."""
