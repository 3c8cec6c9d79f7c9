"""Linear solvers, quasi-Newton, and the quasi-static path."""
