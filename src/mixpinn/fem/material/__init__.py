"""Materials as users write them."""
