"""Volume meshers, how long edges are, and where points lie."""
