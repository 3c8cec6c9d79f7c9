"""A scene with one thing changed."""

from collections.abc import Callable
from dataclasses import dataclass

from mixpinn.fem import Scene
from mixpinn.records.error_budget import BudgetKind


@dataclass(frozen=True, eq=False)
class Variant:
    """A scene with one thing changed.

    Attributes:
        source: what is changed; several variants of one source make one entry, the larger change counting.
        kind: whether the change shows an error or a sensitivity.
        value: what it is changed to, in words.
        scene: makes it; solved only where it is needed.
        same_vertices: whether its first vertices are those of the bundle's mesh.
        scale: what its change is multiplied with, where it stands for a larger one.
        note: what a reader must know beside the figures.
    """

    source: str
    kind: BudgetKind
    value: str
    scene: Callable[[], Scene]
    same_vertices: bool = True
    scale: float = 1.0
    note: str = ""
