"""Shared machinery below every layer: errors, files, configuration, progress, run directories."""
