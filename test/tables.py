"""Checks of the tables of generated pages."""

import re


def check_tables(text):
    """Every line of a table has as many cells as its head; returns how many tables there are."""
    blocks = re.findall(r"(?:^\|.*\|\n)+", text, re.MULTILINE)
    for block in blocks:
        lines = block.splitlines()
        assert re.fullmatch(r"\|( -+:? \|)+", lines[1])
        assert {line.count(" | ") for line in lines[:1] + lines[2:]} == {lines[1].count(" | ")}
        assert len({len(line) for line in lines}) == 1  # aligned
    return len(blocks)
