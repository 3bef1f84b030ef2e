"""The subject "files": spoiled bags, clouds, maps and parameter files, given to the commands."""

from collections import Counter

from studies.endurance.file_trials import (
    ADDRESSES,
    LIMIT,
    MEMORY_MB,
    SKIPPED,
    WHOLE,
    Outcome,
    try_files,
)
from studies.endurance.promises import Promise, Trial

CASES, QUICK = 100, 6  # of every kind


def files(trial: Trial) -> list[Promise]:
    """Spoil files of every kind, and look at what a user gets to see."""
    found: list[Outcome] = []
    for outcome in try_files(trial.seed, QUICK if trial.quick else CASES):
        found.append(outcome)
        if outcome.fault:
            trial.say(f"files: {outcome.kind}, {outcome.damage}: {outcome.fault}")
        if len(found) % 100 == 0:
            trial.say(f"files: {len(found)} files")
    return promises(found)


def promises(found: list[Outcome]) -> list[Promise]:
    """The rows of what came of all files."""
    whole = [one for one in found if one.damage == WHOLE]
    spoiled = [one for one in found if one.damage not in (WHOLE, SKIPPED)]
    skipped = len(found) - len(whole) - len(spoiled)
    kinds = ", ".join(one.kind for one in whole)
    how = (
        f"{len(spoiled)} files ({kinds}): cut off, bits flipped, sizes that lie, blocks lost, "
        "empty, noise, of another kind, missing, a folder"
        + (f"; {skipped} more that are locked, left out: root may read them" if skipped else "")
    )
    codes = Counter(one.code for one in spoiled)
    faults = [one for one in found if one.fault]
    good = sum(one.code == 0 for one in whole)
    slowest = max((one.seconds for one in spoiled), default=0.0)
    most = max((one.memory_mb for one in spoiled), default=0.0)
    return [
        Promise(
            "A spoiled file gives one clear line and exit code 2, or its damage does not show; "
            "never a traceback, nor results in part",
            f"{how}; {len(whole)} that are whole",
            f"{codes[2]} refused, {codes[0]} read, {len(faults)} otherwise; "
            f"{good} of {len(whole)} whole ones read",
            not faults and good == len(whole) and codes[2] > 0,
        ),
        Promise(
            f"It costs neither time (at most {LIMIT:g} s) nor memory (at most {MEMORY_MB:g} MB), "
            "whatever its header claims",
            f"the same, in a process that may ask for {ADDRESSES / 2**30:g} GiB more than it has",
            f"{slowest:.1f} s and {most:.0f} MB at most",
            slowest < LIMIT and most < MEMORY_MB,
        ),
    ]
