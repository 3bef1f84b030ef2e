"""Damage to files: truncated, bits flipped, wrong headers, other contents, missing."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np

Damage = Callable[[Path, Path, np.random.Generator], None]
HEADER_BYTES = 600  # at the start of a file
NUMBERS = (b"0", b"-1", b"4000000000", b"99999999999999999999", b"1e9", b"nan")
LOCKED = "locked"
WORDS = (0, 1, 2**31 - 1, 2**31, 2**32 - 1)


def damage(path: Path, other: Path, seed: int, case: int) -> str:
    """Damage a file, or one file of a folder, in place; returns the kind of damage.

    other: a file of another kind.
    """
    rng = np.random.default_rng([seed, case])
    name = list(DAMAGES)[rng.integers(len(DAMAGES))]
    DAMAGES[name](path, other, rng)
    return name


def _part(path: Path, rng: np.random.Generator) -> Path:
    if path.is_file():
        return path
    parts = sorted(part for part in path.iterdir() if part.is_file())
    return parts[rng.integers(len(parts))]


def _truncate(path: Path, _: Path, rng: np.random.Generator) -> None:
    part = _part(path, rng)
    data = part.read_bytes()
    part.write_bytes(data[: rng.integers(0, len(data))])


def _flip(path: Path, _: Path, rng: np.random.Generator) -> None:
    """Flip a few bits near the start or anywhere."""
    part = _part(path, rng)
    data = np.frombuffer(part.read_bytes(), np.uint8).copy()
    within = len(data) if rng.random() < 0.5 else min(HEADER_BYTES, len(data))
    where = rng.integers(0, within, rng.integers(1, 20))
    data[where] ^= np.uint8(1) << rng.integers(0, 8, len(where)).astype(np.uint8)
    part.write_bytes(data.tobytes())


def _change_size(path: Path, _: Path, rng: np.random.Generator) -> None:
    """Replace four bytes near the start or the end by a number that may be a size."""
    part = _part(path, rng)
    data = bytearray(part.read_bytes())
    place = int(rng.integers(0, min(HEADER_BYTES, len(data) - 4)))
    if rng.random() < 0.3:
        place = len(data) - 4 - place
    data[place : place + 4] = int(rng.choice(WORDS)).to_bytes(4, "little")
    part.write_bytes(bytes(data))


def _change_number(path: Path, _: Path, rng: np.random.Generator) -> None:
    """Replace a number written in digits."""
    part = _part(path, rng)
    data = part.read_bytes()
    numbers = list(re.finditer(rb"\d+(\.\d+)?", data[:HEADER_BYTES]))
    if numbers:
        which = numbers[rng.integers(len(numbers))]
        number = NUMBERS[rng.integers(len(NUMBERS))]
        data = data[: which.start()] + number + data[which.end() :]
    part.write_bytes(data)


def _insert(path: Path, _: Path, rng: np.random.Generator) -> None:
    """Insert or delete bytes in the middle."""
    part = _part(path, rng)
    data = part.read_bytes()
    place = int(rng.integers(0, len(data)))
    behind = place if rng.random() < 0.5 else place + int(rng.integers(1, 50))
    part.write_bytes(data[:place] + rng.bytes(int(rng.integers(0, 50))) + data[behind:])


def _zero(path: Path, _: Path, rng: np.random.Generator) -> None:
    """Zero a block, as if it was never written before a crash."""
    part = _part(path, rng)
    data = bytearray(part.read_bytes())
    place = int(rng.integers(0, len(data)))
    data[place : place + 512] = bytes(len(data[place : place + 512]))
    part.write_bytes(bytes(data))


def _empty(path: Path, _: Path, rng: np.random.Generator) -> None:
    _part(path, rng).write_bytes(b"")


def _randomize(path: Path, _: Path, rng: np.random.Generator) -> None:
    _part(path, rng).write_bytes(rng.bytes(int(rng.integers(1, 3000))))


def _other(path: Path, other: Path, rng: np.random.Generator) -> None:
    """Replace the contents by those of a file of another kind."""
    _part(path, rng).write_bytes(_part(other, rng).read_bytes())


def _remove(path: Path, _: Path, rng: np.random.Generator) -> None:
    _part(path, rng).unlink()


def _folder(path: Path, _: Path, rng: np.random.Generator) -> None:
    """Put a folder in place of a file."""
    part = _part(path, rng)
    part.unlink()
    part.mkdir()


def _file(path: Path, _: Path, rng: np.random.Generator) -> None:
    """Put a file in place of a folder, or a broken link in place of a file."""
    if path.is_dir():
        shutil.rmtree(path)
        path.write_bytes(b"not a folder")
    else:
        path.unlink()
        path.symlink_to("nowhere")


def _locked(path: Path, _: Path, rng: np.random.Generator) -> None:
    """Remove the read permission, which does not count for root."""
    _part(path, rng).chmod(0)


DAMAGES: dict[str, Damage] = {  # the first four kinds twice, to be twice as frequent
    "truncated": _truncate,
    "cut": _truncate,
    "bits flipped": _flip,
    "bits": _flip,
    "a wrong size": _change_size,
    "sizes": _change_size,
    "a wrong number": _change_number,
    "numbers": _change_number,
    "bytes lost": _insert,
    "a block of zeros": _zero,
    "empty": _empty,
    "random bytes": _randomize,
    "another kind": _other,
    "missing": _remove,
    "a folder": _folder,
    "a file": _file,
    LOCKED: _locked,
}
