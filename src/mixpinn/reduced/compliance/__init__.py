"""The compliance of a prior: how every unknown answers to forces on contact nodes, whole, in factors or in clusters."""
