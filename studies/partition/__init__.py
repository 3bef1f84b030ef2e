"""Partition quality: segments and objects against labelled clouds, beside other methods."""
