"""What becomes of files: cut off, bits flipped, headers that lie, other contents, gone."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np

Damage = Callable[[Path, Path, np.random.Generator], None]
HEAD = 600  # bytes, where headers are
CLAIMS = (b"0", b"-1", b"4000000000", b"99999999999999999999", b"1e9", b"nan")
LOCKED = "locked"
WORDS = (0, 1, 2**31 - 1, 2**31, 2**32 - 1)


def damage(good: Path, other: Path, seed: int, case: int) -> str:
    """Spoil a file, or one file of a folder, in place; other: of another kind. Returns how."""
    rng = np.random.default_rng([seed, case])
    name = list(DAMAGES)[rng.integers(len(DAMAGES))]
    DAMAGES[name](good, other, rng)
    return name


def _part(path: Path, rng: np.random.Generator) -> Path:
    if path.is_file():
        return path
    parts = sorted(part for part in path.iterdir() if part.is_file())
    return parts[rng.integers(len(parts))]


def _cut(path: Path, _: Path, rng: np.random.Generator) -> None:
    part = _part(path, rng)
    data = part.read_bytes()
    part.write_bytes(data[: rng.integers(0, len(data))])


def _flip(path: Path, _: Path, rng: np.random.Generator) -> None:
    """A few bits, near the beginning or anywhere."""
    part = _part(path, rng)
    data = np.frombuffer(part.read_bytes(), np.uint8).copy()
    within = len(data) if rng.random() < 0.5 else min(HEAD, len(data))
    where = rng.integers(0, within, rng.integers(1, 20))
    data[where] ^= np.uint8(1) << rng.integers(0, 8, len(where)).astype(np.uint8)
    part.write_bytes(data.tobytes())


def _word(path: Path, _: Path, rng: np.random.Generator) -> None:
    """Four bytes near the beginning or the end become a number that is a size, perhaps."""
    part = _part(path, rng)
    data = bytearray(part.read_bytes())
    place = int(rng.integers(0, min(HEAD, len(data) - 4)))
    if rng.random() < 0.3:
        place = len(data) - 4 - place
    data[place : place + 4] = int(rng.choice(WORDS)).to_bytes(4, "little")
    part.write_bytes(bytes(data))


def _claim(path: Path, _: Path, rng: np.random.Generator) -> None:
    """A number written in digits becomes another one."""
    part = _part(path, rng)
    data = part.read_bytes()
    numbers = list(re.finditer(rb"\d+(\.\d+)?", data[:HEAD]))
    if numbers:
        which = numbers[rng.integers(len(numbers))]
        claim = CLAIMS[rng.integers(len(CLAIMS))]
        data = data[: which.start()] + claim + data[which.end() :]
    part.write_bytes(data)


def _stuff(path: Path, _: Path, rng: np.random.Generator) -> None:
    """Bytes come in, or go, in the midst."""
    part = _part(path, rng)
    data = part.read_bytes()
    place = int(rng.integers(0, len(data)))
    behind = place if rng.random() < 0.5 else place + int(rng.integers(1, 50))
    part.write_bytes(data[:place] + rng.bytes(int(rng.integers(0, 50))) + data[behind:])


def _zeros(path: Path, _: Path, rng: np.random.Generator) -> None:
    """A block that was never written, as after a crash."""
    part = _part(path, rng)
    data = bytearray(part.read_bytes())
    place = int(rng.integers(0, len(data)))
    data[place : place + 512] = bytes(len(data[place : place + 512]))
    part.write_bytes(bytes(data))


def _empty(path: Path, _: Path, rng: np.random.Generator) -> None:
    _part(path, rng).write_bytes(b"")


def _noise(path: Path, _: Path, rng: np.random.Generator) -> None:
    _part(path, rng).write_bytes(rng.bytes(int(rng.integers(1, 3000))))


def _other(path: Path, other: Path, rng: np.random.Generator) -> None:
    """The contents of a file of another kind."""
    _part(path, rng).write_bytes(_part(other, rng).read_bytes())


def _gone(path: Path, _: Path, rng: np.random.Generator) -> None:
    _part(path, rng).unlink()


def _folder(path: Path, _: Path, rng: np.random.Generator) -> None:
    """A folder where a file should be."""
    part = _part(path, rng)
    part.unlink()
    part.mkdir()


def _file(path: Path, _: Path, rng: np.random.Generator) -> None:
    """A file where a folder should be, or a link to nowhere where a file should."""
    if path.is_dir():
        shutil.rmtree(path)
        path.write_bytes(b"no folder")
    else:
        path.unlink()
        path.symlink_to("nowhere")


def _locked(path: Path, _: Path, rng: np.random.Generator) -> None:
    """Without permission to read, which hinders everybody but root."""
    _part(path, rng).chmod(0)


DAMAGES: dict[str, Damage] = {
    "cut off": _cut,
    "cut": _cut,
    "bits flipped": _flip,
    "bits": _flip,
    "a size that lies": _word,
    "sizes": _word,
    "a number that lies": _claim,
    "numbers": _claim,
    "bytes lost": _stuff,
    "a block of zeros": _zeros,
    "empty": _empty,
    "noise": _noise,
    "another kind": _other,
    "gone": _gone,
    "a folder": _folder,
    "a file": _file,
    LOCKED: _locked,
}
