"""Laws and kernels without state, which the solver and the reduced side share."""
