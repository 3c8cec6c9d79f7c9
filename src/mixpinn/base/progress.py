"""Progress bars with time left, for everything that lasts longer than a moment."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

T = TypeVar("T")
console = Console(stderr=True)


def progress_bar() -> Progress:
    """A `rich` progress display: description, bar, count, elapsed time, time left; on standard error."""
    return Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        TextColumn("left"), TimeRemainingColumn(), console=console,
    )


def track(items: Iterable[T], description: str, *, total: int | None = None) -> Iterator[T]:
    """Yield `items` behind a progress bar labelled `description`."""
    with progress_bar() as bar:
        yield from bar.track(items, total=total, description=description)


@contextmanager
def quiet() -> Iterator[None]:
    """Print nothing while this lasts: the bars of several processes on one terminal show nothing."""
    before = console.quiet
    console.quiet = True
    try:
        yield
    finally:
        console.quiet = before
