"""What a check finds: figures against bars, a text and a picture."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt


@dataclass(frozen=True)
class Result:
    """One figure against its bar; the value is NaN where a check could not be made.

    Attributes:
        check: name of the figure.
        value: what came out.
        bar: what is asked for.
        met: whether it is reached.
    """

    check: str
    value: float
    bar: str
    met: bool

    @staticmethod
    def at_most(check: str, value: float, bar: float, unit: str = "") -> "Result":
        """A figure that may not exceed `bar`."""
        return Result(check, float(value), f"≤ {bar:g}{unit}", bool(value <= bar))

    @staticmethod
    def within(check: str, value: float, low: float, high: float, unit: str = "") -> "Result":
        """A figure that must lie in [low, high]."""
        return Result(check, float(value), f"{low:g} … {high:g}{unit}", bool(low <= value <= high))

    def json(self) -> dict[str, Any]:
        """As an entry of the list that the command prints."""
        value = self.value if self.value == self.value else None  # JSON has no NaN
        return {"check": self.check, "value": value, "bar": self.bar, "met": self.met}


@dataclass(frozen=True)
class Section:
    """A section of the page.

    Attributes:
        title: heading.
        text: how the check is made, Markdown.
        results: the figures.
        picture: file name within the page's folder of pictures, if any.
        table: further figures, the first row being the header.
    """

    title: str
    text: str
    results: tuple[Result, ...]
    picture: str | None = None
    table: tuple[tuple[str, ...], ...] = ()


def picture(folder: Path, name: str, draw: Callable[[Any], None], *, size: tuple[float, float] = (4.6, 3.0)) -> str:
    """Draw on the axes of a new figure and save it as `folder`/`name`.png; returns the file name."""
    figure, axes = plt.subplots(figsize=size, layout="constrained")
    draw(axes)
    for spine in ("top", "right"):
        axes.spines[spine].set_visible(False)
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / f"{name}.png", dpi=110)
    plt.close(figure)
    return f"{name}.png"
