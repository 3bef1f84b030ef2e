"""Two passes over one simulated scene: what of the first is found again in the second."""
