"""Poisons: files and settings that no honest program writes, each with its recipe in one line.

A recipe takes a `Kitchen`, makes what it needs, and says the words of the command that must refuse it.
"""

from drill.poisons_in_arrays import ARRAYS, LABELS, MESHES
from drill.poisons_in_text import JSON, SETTINGS, TABLES

POISONS = {
    f"{group}: {name}": recipe
    for group, recipes in (
        ("table", TABLES), ("settings", SETTINGS), ("JSON", JSON), ("array", ARRAYS), ("mesh", MESHES),
        ("labels", LABELS),
    ) for name, recipe in recipes.items()
}
