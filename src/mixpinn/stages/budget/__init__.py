"""The error budget of a bundle."""
