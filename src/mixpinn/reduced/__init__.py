"""Reduced models: elastic prior, modes, equilibrium on them, hybrid model, error estimate, and their fits."""
