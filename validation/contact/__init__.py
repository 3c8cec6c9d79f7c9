"""Contact against theory: balance, friction, Hertz, pressure, and the probe's side of it."""
