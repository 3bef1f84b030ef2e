"""Checks of the tables of generated pages."""

import re


def check_tables(text):
    """Assert that all lines of a table have equally many cells; returns the number of tables."""
    blocks = re.findall(r"(?:^\|.*\|\n)+", text, re.MULTILINE)
    for block in blocks:
        lines = block.splitlines()
        assert re.fullmatch(r"\|( -+:? \|)+", lines[1])
        assert {line.count(" | ") for line in lines[:1] + lines[2:]} == {lines[1].count(" | ")}
        assert len({len(line) for line in lines}) == 1  # aligned
    return len(blocks)
