"""Contact from the pose of the probe, solved on the elastic prior; the solver takes no part."""
