"""Meshes small enough to check by hand."""

from small_meshes import random_mesh, two_cells

__all__ = ["random_mesh", "two_cells"]
