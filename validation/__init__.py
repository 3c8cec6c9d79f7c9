"""Validation of the finite elements against theory, an independent code, and recorded fields of SOFA."""
