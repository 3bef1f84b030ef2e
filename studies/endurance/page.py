"""Promises and figures as Markdown."""

from typing import Any

from studies.endurance.subjects import SUBJECTS
from studies.report.markdown import machine_line, table

Results = dict[str, Any]  # by name of the subject

INTRODUCTION = """# Reliability

Written by `ellipseg soak`; every figure is of its last run. `make soak` runs all of it, an hour
and a quarter, and `ellipseg soak --quick` short versions, some minutes. `make test` tries all but
the overload, more shortly still, and of the overload the verdicts. It leaves out limits of time
and memory, which a machine breaks that has other things to do.

```bash
ellipseg soak -o docs
```
"""


def page(results: Results) -> str:
    """All of docs/reliability.md."""
    return "\n".join([INTRODUCTION, *blocks(results)])


def blocks(results: Results) -> list[str]:
    """A section for every subject that was tried."""
    return [_section(SUBJECTS[name][0], results[name]) for name in SUBJECTS if name in results]


def _section(title: str, found: Results) -> str:
    rows = [
        [row["promise"], row["tried"], row["figure"], "yes" if row["kept"] else "**no**"]
        for row in found["promises"]
    ]
    version = "the short version, " if found["quick"] else ""
    return (
        f"## {title}\n\n{table(['promise', 'how it was tried', 'figure', 'kept'], rows)}\n"
        f"In {version}{found['minutes']:g} min, seed {found['seed']}. "
        f"{machine_line(found['machine'])}"
    )
