"""The short versions of the long trials, with the real node.

Limits of time and memory are for the long ones: here the machine is busy with other tests.
"""

import pytest

from studies.endurance.promises import Trial
from studies.endurance.subjects import SUBJECTS


@pytest.mark.parametrize("subject", ["hour"])
def test_the_promises_are_kept(subject):
    broken = [row for row in SUBJECTS[subject][1](Trial(quick=True)) if not row.holds]
    assert not broken
