"""Fused graph attention against PyTorch Geometric's `GATConv`: errors, run time, peak memory, in one run.

``python -m benchmarks.gat`` prints a table and, as its last line, a JSON object. The network is MIXPINN (8 layers, 2
heads, virtual nodes) on the paper mesh, found by the environment variable MIXPINN_DATA (default ``../shared/data``), or
a generated mesh of the same number of nodes where it is absent. Runs of the two implementations alternate, and a ratio
is the median of the ratios of neighbouring runs, so that other load on the machine falls on both. Peak memory is what
one training step adds to a fresh process that has imported everything and has run the same network on a small mesh.
"""

import argparse
import functools
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyvista as pv
import torch
from scipy.spatial import Delaunay
from torch import Tensor, nn
from torch_geometric.nn import GATConv

from benchmarks.history import report
from mixpinn.graph import node_input
from mixpinn.networks import MIXPINN, DisplacementModel, GATNetwork, build_graph_for, build_model, mean_euclidean_error
from mixpinn.records import TissueMesh

NAMES = ("L1", "L2", "L3", "L4", "L5")


class ReferenceNetwork(nn.Module):
    """The same stack made of `GATConv` as it comes, with the weights of `network`."""

    def __init__(self, network: GATNetwork) -> None:
        super().__init__()
        self.layers = nn.ModuleList()
        for layer in network.layers:
            copy = GATConv(layer.in_channels, layer.out_channels, heads=layer.heads, concat=layer.concat)
            copy.load_state_dict(layer.state_dict())
            self.layers.append(copy)

    def forward(self, x: Tensor, edge_index: Tensor) -> Tensor:
        """Node features, shape (N, F) → shape (N, 3)."""
        for layer in self.layers[:-1]:
            x = layer(x, edge_index).relu()
        return self.layers[-1](x, edge_index)


def delaunay_mesh(n_points: int, rng: np.random.Generator) -> TissueMesh:
    """A box of random points with five balls of rigid nodes along its axis."""
    points = rng.uniform(-1.0, 1.0, (n_points, 3)) * [200.0, 150.0, 150.0]
    cells = Delaunay(points).simplices.astype(np.int32)
    part = np.zeros(n_points, np.int16)
    for k in range(5):
        part[np.linalg.norm(points - [0.0, 0.0, 55.0 * (k - 2)], axis=1) < 27.0] = k + 1
    return _mesh(points, cells, part)


def paper_mesh() -> TissueMesh | None:
    """The paper mesh, if it is there."""
    default = Path(__file__).parents[1] / ".." / "shared" / "data"
    path = Path(os.environ.get("MIXPINN_DATA", default)) / "patient1" / "paper" / "body.vtu"
    if not path.is_file():
        return None
    grid = pv.read(path)
    cells = np.asarray(grid.cells_dict[pv.CellType.TETRA], np.int32)
    return _mesh(np.asarray(grid.points, np.float64), cells, np.asarray(grid.point_data["rigid"]).astype(np.int16))


def _mesh(points: np.ndarray, cells: np.ndarray, part: np.ndarray) -> TissueMesh:
    return TissueMesh(points, cells, part, np.zeros(len(points), bool), NAMES, np.zeros(len(cells), np.int16))


def contact_field(model: DisplacementModel) -> Tensor:
    """10 mm of indentation at the twenty mesh nodes nearest the back, shape (1, n, 3)."""
    field = torch.zeros(1, model.graph.n_mesh_nodes, 3)
    highest = model.graph.position[: model.graph.n_mesh_nodes, 1].topk(20).indices
    field[0, highest, 1] = -10.0
    return field


def calls(model: DisplacementModel, reference: ReferenceNetwork) -> dict[str, Callable[[], Tensor]]:
    """One forward pass of each implementation, from node features to displacement."""
    x = node_input(model.graph, contact_field(model))
    return {
        "fused": lambda: model.network(x, model.topology)[0],
        "reference": lambda: reference(x[0], model.graph.edge_index),
    }


def training_step(forward: Callable[[], Tensor], optimiser: torch.optim.Optimizer) -> None:
    """Forward, loss, backward and update."""
    optimiser.zero_grad()
    out = forward()
    mean_euclidean_error(out[None], torch.ones_like(out)[None]).backward()
    optimiser.step()


def optimiser_of(module: nn.Module) -> torch.optim.Optimizer:
    """The paper's optimiser, with a step so small that the weights stay comparable."""
    return torch.optim.AdamW(module.parameters(), lr=1e-12, weight_decay=0.01)


def alternate(actions: dict[str, Callable[[], object]], repeats: int) -> dict[str, list[float]]:
    """Seconds of each action, run in turns after one warm run each."""
    seconds: dict[str, list[float]] = {name: [] for name in actions}
    for turn in range(repeats + 1):
        for name, action in actions.items():
            start = time.perf_counter()
            action()
            if turn:
                seconds[name].append(time.perf_counter() - start)
    return seconds


def ratio(seconds: dict[str, list[float]], slow: str = "reference", fast: str = "fused") -> float:
    """Median of the ratios of neighbouring runs."""
    return statistics.median(a / b for a, b in zip(seconds[slow], seconds[fast], strict=True))


def errors(model: DisplacementModel, reference: ReferenceNetwork) -> dict[str, float]:
    """Largest difference of a hidden layer's outputs on standard normal features, and of its gradients (relative)."""
    layer, other = model.network.layers[1], reference.layers[1]
    order, position = model.topology.order, model.topology.position
    x = torch.randn(model.graph.n_nodes, layer.in_channels, generator=torch.Generator().manual_seed(0))
    weight = torch.randn(model.graph.n_nodes, layer.in_channels, generator=torch.Generator().manual_seed(1))
    ours, theirs = x.clone().requires_grad_(), x.clone().requires_grad_()
    fused = layer(ours[None, order], model.topology)[0][position]
    plain = other(theirs, model.graph.edge_index)
    for module in (layer, other):
        module.zero_grad()
    (fused * weight).sum().backward()
    (plain * weight).sum().backward()
    parameters = zip(layer.parameters(), other.parameters(), strict=True)
    pairs = [(ours.grad, theirs.grad), *((a.grad, b.grad) for a, b in parameters)]
    return {
        "max_abs_error": float((fused - plain).detach().abs().max()),
        "max_relative_gradient_error": max(float((a - b).abs().max() / b.abs().max()) for a, b in pairs),
    }


def dense_products(model: DisplacementModel) -> Callable[[], None]:
    """The products Θ x of one forward pass alone."""
    inputs = [torch.randn(model.graph.n_nodes, layer.in_channels) for layer in model.network.layers]

    def run() -> None:
        for layer, x in zip(model.network.layers, inputs, strict=True):
            layer.lin(x)

    return run


def _resident(key: str) -> float:
    """VmRSS or VmHWM of this process [MB]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(key)) / 1024.0


def report_memory(name: str, mesh: TissueMesh, width: str) -> None:
    """Print what one training step of an implementation adds to this process's memory [MB]; Linux only."""
    config = MIXPINN.with_width(width)

    def step(on: TissueMesh) -> None:
        model = build_model(config, build_graph_for(config, on))
        reference = ReferenceNetwork(model.network)
        training_step(calls(model, reference)[name], optimiser_of(model.network if name == "fused" else reference))

    step(delaunay_mesh(200, np.random.default_rng(0)))
    before = _resident("VmRSS")
    Path("/proc/self/clear_refs").write_text("5")
    step(mesh)
    print(_resident("VmHWM") - before)


def memory(name: str, width: str, threads: int) -> float:
    """`report_memory` in a fresh process [MB]."""
    command = [sys.executable, "-m", "benchmarks.gat", "--memory", name, "--width", width, "--threads", str(threads)]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()[-1])


def measure(mesh: TissueMesh, width: str, threads: int, repeats: int) -> dict[str, float | int | str]:
    """All figures at one width."""
    config = MIXPINN.with_width(width)
    model = build_model(config, build_graph_for(config, mesh))
    reference = ReferenceNetwork(model.network)
    result: dict[str, float | int | str] = {"width": width, "threads": threads, **errors(model, reference)}
    forward = calls(model, reference)
    with torch.no_grad():
        fused, plain = forward["fused"](), forward["reference"]()
        result["network_relative_error"] = float((fused - plain).abs().max() / plain.abs().max())
        inference = alternate({**forward, "dense": dense_products(model)}, repeats)
    modules: dict[str, nn.Module] = {"fused": model.network, "reference": reference}
    training = alternate({
        name: functools.partial(training_step, forward[name], optimiser_of(module)) for name, module in modules.items()
    }, max(3, repeats // 3))
    result |= {
        "inference_ratio": ratio(inference), "training_ratio": ratio(training),
        "dense_share": ratio(inference, "dense", "fused"),
        "dense_share_reference": ratio(inference, "dense", "reference"),
        **{f"inference_{name}_ms": 1e3 * statistics.median(values) for name, values in inference.items()},
        **{f"training_{name}_ms": 1e3 * statistics.median(values) for name, values in training.items()},
    }
    megabytes = {name: memory(name, width, threads) for name in ("fused", "reference")}
    return result | {"memory_ratio": megabytes["reference"] / megabytes["fused"]} | {
        f"memory_{name}_mb": value for name, value in megabytes.items()
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--width", default=None, help="one width only (default: authors, then paper)")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=15)
    parser.add_argument("--memory", choices=("fused", "reference"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    mesh, where = paper_mesh(), "paper"
    if mesh is None:
        mesh, where = delaunay_mesh(8746, np.random.default_rng(0)), "generated"
    if options.memory:
        report_memory(options.memory, mesh, options.width)
        return
    results = {}
    for width in [options.width] if options.width else ["authors", "paper"]:
        results[width] = measure(mesh, width, options.threads, options.repeats)
        print(f"width {width}, {where} mesh")
        for name, value in results[width].items():
            print(f"  {name:30s} {value:.4g}" if isinstance(value, float) else f"  {name:30s} {value}")
    first, *others = results.values()
    report("gat", {"mesh": where, **first, **{f"{other['width']}": other for other in others}})


if __name__ == "__main__":
    main()
