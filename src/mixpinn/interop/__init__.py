"""Scenes out to, and recordings in from, other simulators."""
