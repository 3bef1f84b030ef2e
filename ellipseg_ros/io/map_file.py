"""Files of landmark maps: format version 1, an NPZ without pickled objects.

`format` (text), `version` (integer), `frame_id` (text), `next_id` (integer), `last_seen_ns`, and
the arrays of Landmarks by their names, see records.py. Numbers of a landmark are in m
and rad, in the frame `frame_id`.
"""

from pathlib import Path
from typing import Any

import numpy as np

from ellipseg_ros.association.landmark_map import ROW_SHAPES, StoredMap
from ellipseg_ros.errors import InputError, reason
from ellipseg_ros.io.atomic_files import replacing
from ellipseg_ros.io.formats.npz import check_archive
from ellipseg_ros.records import Array, Landmarks

FORMAT = "ellipseg_ros landmark map"
VERSION = 1
MAX_UNPACKED_BYTES = 512 * 1024 * 1024  # half a million landmarks
NAMES = ("format", "version", "frame_id", "next_id", "last_seen_ns", *ROW_SHAPES)


def write_map(path: Path, stored: StoredMap) -> None:
    """Write a map, atomically. Raises InputError if the file can't be written."""
    values: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "frame_id": stored.frame_id,
        "next_id": stored.next_id,
        "last_seen_ns": stored.last_seen_ns,
        **{name: getattr(stored.landmarks, name) for name in ROW_SHAPES},
    }
    with replacing(path) as part, part.open("wb") as file:
        np.savez_compressed(file, **values)


def read_map(path: Path) -> StoredMap:
    """Read a map. Raises InputError, in one line, if the file is not a valid map."""
    try:
        check_archive(path, MAX_UNPACKED_BYTES)
        with np.load(path, allow_pickle=False) as file:
            values = {name: file[name] for name in NAMES if name in file.files}
        return _checked(values)
    except FileNotFoundError as error:
        raise InputError(f"there is no file {path}", "map") from error
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}", "map") from error
    except Exception as error:  # of zipfile, zlib, struct, numpy and its parser: nearly anything
        raise InputError(f"{path} is no map of landmarks: {reason(error)}", "map") from error


def _checked(values: dict[str, Array]) -> StoredMap:
    """The map from the arrays of a file; raises InputError if it is not valid."""
    missing = [name for name in NAMES if name not in values]
    if missing:
        raise InputError(f"it has no {missing[0]}")
    if str(values["format"]) != FORMAT:
        raise InputError("its format is another")
    if values["version"].shape != () or values["version"] != VERSION:
        raise InputError(f"it has version {values['version']}; this program reads {VERSION}")
    scalar = all(values[name].shape == () for name in ("frame_id", "next_id"))
    if not scalar or values["next_id"].dtype.kind not in "iu":
        raise InputError("frame_id must be a text, next_id an integer")
    last_seen_ns = values["last_seen_ns"]
    if last_seen_ns.dtype != np.int64 or last_seen_ns.ndim != 1:
        raise InputError("last_seen_ns must be a row of int64")
    if values["ids"].ndim != 1:
        raise InputError("ids must be a row")
    landmarks = Landmarks(**{name: values[name] for name in ROW_SHAPES})
    return StoredMap(landmarks, last_seen_ns, str(values["frame_id"]), int(values["next_id"]))
