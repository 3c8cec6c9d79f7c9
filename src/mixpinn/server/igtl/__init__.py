"""OpenIGTLink: the protocol's messages, and a loaded predictor behind it."""
