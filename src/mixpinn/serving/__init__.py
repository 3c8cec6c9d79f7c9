"""Load a trained model once, predict many times."""
