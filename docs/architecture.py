"""Draw the rooms of the package, their order in the import contract, and what really imports what.

The order is that of ``[tool.importlinter]`` in pyproject.toml; arrows and counts come from the source itself. Run by
the build of the site, so that the picture cannot differ from the code.
"""

import tomllib
from pathlib import Path

import grimp
import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

ROOT = Path(__file__).parents[1]
PACKAGE = "mixpinn"
WIDTH, HEIGHT = 3.0, 0.74
"""Of a box, in the drawing's units; rows are one unit apart."""


def contract_layers() -> list[list[str]]:
    """Rooms from the highest layer to the lowest, those of one layer together."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    layers = next(contract["layers"] for contract in settings["contracts"] if contract["type"] == "layers")
    return [[room.strip() for room in layer.replace(":", "|").split("|")] for layer in layers]


def imports_between_rooms() -> dict[tuple[str, str], int]:
    """Number of modules of the first room that import one of the second."""
    graph = grimp.build_graph(PACKAGE)
    found: dict[tuple[str, str], set[str]] = {}
    for module in graph.modules:
        for other in graph.find_modules_directly_imported_by(module):
            rooms = tuple(name.split(".")[1] if "." in name else "" for name in (module, other))
            if all(rooms) and rooms[0] != rooms[1]:
                found.setdefault((rooms[0], rooms[1]), set()).add(module)
    return {pair: len(modules) for pair, modules in found.items()}


def reduced(arrows: dict[tuple[str, str], int]) -> dict[tuple[str, str], int]:
    """The arrows without those that a way over other rooms implies: what is left still says who may depend on whom."""
    used: dict[str, set[str]] = {}
    for first, second in arrows:
        used.setdefault(first, set()).add(second)

    def reach(room: str) -> set[str]:
        return {room}.union(*(reach(other) for other in used.get(room, ())))

    return {
        (first, second): count for (first, second), count in arrows.items()
        if not any(second in reach(other) for other in used[first] - {second})
    }


def size_of(room: str) -> tuple[int, int]:
    """Files and lines of a room; both zero where the contract names one that is not there yet."""
    place = ROOT / "src" / PACKAGE / room
    files = sorted(place.rglob("*.py")) or [path for path in [place.with_suffix(".py")] if path.exists()]
    return len(files), sum(len(path.read_text(encoding="utf-8").splitlines()) for path in files)


def draw(path: Path) -> None:
    """Write the picture as SVG."""
    layers, arrows = contract_layers(), reduced(imports_between_rooms())
    place = {
        room: ((column - 0.5 * (len(layer) - 1)) * 1.15 * WIDTH, -float(row))
        for row, layer in enumerate(layers) for column, room in enumerate(layer)
    }
    figure = Figure(figsize=(7.5, 0.55 * len(layers)), layout="constrained")
    axes = figure.subplots()
    _draw_arrows(axes, arrows, place)
    for room, (x, y) in place.items():
        files, lines = size_of(room)
        if not files:
            continue
        axes.add_patch(mpl.patches.FancyBboxPatch(
            (x - 0.5 * WIDTH, y - 0.5 * HEIGHT), WIDTH, HEIGHT, boxstyle="round,pad=0,rounding_size=0.12",
            facecolor="#eef3f8", edgecolor="#35648c", linewidth=1.0, zorder=3,
        ))
        axes.text(x, y + 0.13, room, ha="center", va="center", fontsize=11, weight="bold", zorder=4)
        counts = f"{files} file{'s' if files > 1 else ''}, {lines:,} lines"
        axes.text(x, y - 0.19, counts, ha="center", va="center", fontsize=7.5, zorder=4)
    axes.set(xlim=(-5.2, 5.2), ylim=(-len(layers) + 0.3, 0.7))
    axes.set_axis_off()
    path.parent.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context({"svg.hashsalt": PACKAGE}):
        figure.savefig(path, format="svg", metadata={"Date": None})


def _draw_arrows(axes: Axes, arrows: dict[tuple[str, str], int], place: dict[str, tuple[float, float]]) -> None:
    """An arrow for each pair of rooms, the wider the more modules import; on both sides in turn."""
    downward = sorted(pair for pair in arrows if set(pair) <= place.keys())
    for index, (user, used) in enumerate(downward):
        (x0, y0), (x1, y1) = place[user], place[used]
        side = 1.0 if index % 2 else -1.0
        span = y0 - y1
        neighbour = span <= 1.0
        start, end = (
            ((x0, y0 - 0.5 * HEIGHT), (x1, y1 + 0.5 * HEIGHT)) if neighbour
            else ((x0 + side * 0.5 * WIDTH, y0), (x1 + side * 0.5 * WIDTH, y1))
        )
        # An arc of the same way bulges by a share of its length: the longer the way, the flatter it is drawn.
        bend = 0.0 if neighbour else -side * min(0.5, 1.2 / span + 0.08)
        axes.add_patch(mpl.patches.FancyArrowPatch(
            start, end, connectionstyle=f"arc3,rad={bend}", arrowstyle="-|>", mutation_scale=11, shrinkA=0, shrinkB=0,
            linewidth=0.8 + 0.15 * min(arrows[user, used], 8), color="#5b6b7a", alpha=0.9, zorder=1,
        ))


if __name__ == "__main__":
    target = ROOT / "docs" / "generated" / "architecture.svg"
    draw(target)
    print(target)
