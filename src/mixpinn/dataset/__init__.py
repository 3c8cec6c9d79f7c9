"""Poses, splits, generation and the store of simulations."""
