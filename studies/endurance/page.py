"""Results of the endurance and fault-injection tests as a page."""

from typing import Any

from studies.endurance.subjects import SUBJECTS
from studies.report.machine import machine_line
from studies.report.page import Page, Section
from studies.report.requirements import requirement_table

Results = dict[str, Any]  # by name of the subject

INTRODUCTION = (
    "Requirements on the node under load, odd input and injected faults, how each was tested, "
    "and what was measured in the last run of each subject.",
    "`python -m studies.endurance --quick` runs short versions in some minutes. `make test` runs "
    "even shorter ones, except of the overload, and ignores limits of time and memory, which a "
    "busy machine exceeds.",
)


def page(results: Results) -> Page:
    """The page endurance.md: a section for every tested subject."""
    return Page(
        name="endurance",
        title="Endurance and fault injection",
        introduction=INTRODUCTION,
        sections=[
            _section(subject.title, results[name])
            for name, subject in SUBJECTS.items()
            if name in results
        ],
        command="python -m studies.endurance -o docs/results    # 75 min",
    )


def _section(title: str, result: Results) -> Section:
    version = "Short version, " if result["quick"] else ""
    duration = f"{version}{result['minutes']:g} min, seed {result['seed']}."
    return Section(
        title,
        [
            requirement_table(result["requirements"]),
            f"{duration} {machine_line(result['machine'])}",
        ],
    )
