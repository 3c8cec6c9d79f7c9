"""Closed surfaces that bound the parts: extracted from a label map, checked, with their rims."""
