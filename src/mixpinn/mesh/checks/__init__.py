"""What a mesh is checked for: shape of its cells, faithfulness, size, and what is odd about it."""
