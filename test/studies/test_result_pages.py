"""The result pages in docs/results follow from the numbers beside them."""

import json
import re
from pathlib import Path

import pytest
from tables import check_tables

from studies.benchmark.page import page as benchmark
from studies.endurance.page import page as endurance
from studies.landmarks.page import page as landmarks
from studies.paper.page import page as paper
from studies.paper.readings import page as readings
from studies.partition.page import page as partition
from studies.partition.scale.page import page as scale

RESULTS = Path(__file__).parents[2] / "docs" / "results"
PAGES = {
    "benchmark": benchmark,
    "endurance": endurance,
    "landmarks": landmarks,
    "paper": paper,
    "partition": partition,
    "readings": readings,
    "scale": scale,
}


@pytest.mark.parametrize("name", PAGES)
def test_a_page_follows_from_its_numbers(name):
    results = json.loads((RESULTS / f"{name}.json").read_text())
    text = (RESULTS / f"{name}.md").read_text()
    assert text == PAGES[name](results).markdown()
    assert check_tables(text) >= 1
    for link in re.findall(r"\]\(([^)#]+)\)", text):
        assert (RESULTS / link).exists(), link
