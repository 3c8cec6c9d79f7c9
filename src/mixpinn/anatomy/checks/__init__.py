"""What an anatomy is checked for: its labels, its numbers, its place, its sides, what is pressed."""
