"""Subject `files`: damaged bags, clouds, maps and parameter files given to the commands."""

from collections import Counter

from studies.endurance.file_trials import (
    EXTRA_ADDRESSES,
    INTACT,
    MAX_MEMORY_MB,
    SKIPPED,
    TIMEOUT_S,
    Outcome,
    try_files,
)
from studies.endurance.requirements import Options, Requirement

CASES, QUICK_CASES = 100, 6  # of every kind of file


def files(options: Options) -> list[Requirement]:
    """Damage files of every kind and read them with the commands."""
    outcomes: list[Outcome] = []
    for outcome in try_files(options.seed, QUICK_CASES if options.quick else CASES):
        outcomes.append(outcome)
        if outcome.fault:
            options.log(f"files: {outcome.kind}, {outcome.damage}: {outcome.fault}")
        if len(outcomes) % 100 == 0:
            options.log(f"files: {len(outcomes)} files")
    return file_requirements(outcomes)


def file_requirements(outcomes: list[Outcome]) -> list[Requirement]:
    """Requirements on the outcomes of all files."""
    intact = [outcome for outcome in outcomes if outcome.damage == INTACT]
    damaged = [outcome for outcome in outcomes if outcome.damage not in (INTACT, SKIPPED)]
    skipped = len(outcomes) - len(intact) - len(damaged)
    kinds = ", ".join(outcome.kind for outcome in intact)
    test = (
        f"{len(damaged)} files ({kinds}): truncated, bits flipped, wrong sizes, blocks lost, "
        "empty, random bytes, of another kind, missing, a folder"
        + (f"; {skipped} more without read permission skipped, as root reads them" * bool(skipped))
    )
    codes = Counter(outcome.code for outcome in damaged)
    faults = [outcome for outcome in outcomes if outcome.fault]
    read = sum(outcome.code == 0 for outcome in intact)
    slowest = max((outcome.seconds for outcome in damaged), default=0.0)
    memory = max((outcome.memory_mb for outcome in damaged), default=0.0)
    return [
        Requirement(
            "a damaged file gives one clear line and exit code 2, or its damage has no effect; "
            "never a traceback or partial results",
            f"{test}; {len(intact)} intact files",
            f"{codes[2]} rejected, {codes[0]} read, {len(faults)} faults; "
            f"{read} of {len(intact)} intact files read",
            not faults and read == len(intact) and codes[2] > 0,
        ),
        Requirement(
            f"it takes at most {TIMEOUT_S:g} s and {MAX_MEMORY_MB:g} MB, whatever its header "
            "states",
            f"the same, in a process limited to {EXTRA_ADDRESSES / 2**30:g} GiB more than it has",
            f"at most {slowest:.1f} s and {memory:.0f} MB",
            slowest < TIMEOUT_S and memory < MAX_MEMORY_MB,
        ),
    ]
