"""Formats of cloud files: a module each, which reads a file as a structured array of points.

To add a format, write a module with a function `read(path)` and add a row to FORMATS. `read`
returns (n,) structured points with fields x, y, z (m), imports its library itself, and compares
the claims of the header with the size of the file before a library allocates memory for them.
Errors of any kind become one line in `cloud_file.read_fields`.
"""

from ellipseg_ros.io.formats import las, npz, pcd, ply

FORMATS = {".pcd": pcd, ".ply": ply, ".las": las, ".laz": las, ".npz": npz}
