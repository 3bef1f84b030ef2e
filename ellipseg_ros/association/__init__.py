"""Data association of landmarks, and the map that they are kept in."""
