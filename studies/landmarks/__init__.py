"""Repeatability and association of landmarks over two drives through a simulated scene."""
