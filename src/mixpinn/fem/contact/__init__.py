"""Frictional contact of the probe with the skin."""
