"""Objects: groups of segments."""
