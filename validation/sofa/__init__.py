"""SOFA's recorded fields against the solver."""
