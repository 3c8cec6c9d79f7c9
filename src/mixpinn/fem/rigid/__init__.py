"""Exact rigid bodies."""
