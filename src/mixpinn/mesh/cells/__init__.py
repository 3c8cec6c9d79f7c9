"""Tetrahedra: what is what in them, their orientation, their refinement."""
