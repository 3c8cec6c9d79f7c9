"""How much of a Newton step the cells near a contact hold.

``python -m benchmarks.near_cells BUNDLE --store STORE`` asks for the step in the bundle's modes from all cells and from
those within some reach of the contact nodes (`mixpinn.reduced.near_cells`), at simulated contacts spread over a store.
The last line is a JSON object with lists over the reaches: ``reach_mm``, ``error_p50`` and ``error_p95`` (norm of the
difference relative to that of the step from all cells), ``cells`` (median number that is summed over), and ``ms``
(median time of a step asked for near the contact alone); ``all_cells`` and ``all_ms`` beside them.
"""

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.history import report
from mixpinn.dataset import SimulationStore, build_sample_table
from mixpinn.physics.single_precision import LANES
from mixpinn.reduced.compliance.clusters import ClusteredCompliance
from mixpinn.reduced.hybrid import HybridModel, load_bundle_mesh
from mixpinn.reduced.near_answer import NearAnswer
from mixpinn.reduced.near_cells import NearCells

_parser = argparse.ArgumentParser(description=__doc__)
_parser.add_argument("bundle", type=Path)
_parser.add_argument("--store", type=Path, required=True, help="simulations, of the bundle's mesh")
_parser.add_argument("--reach", type=float, nargs="+", default=[15.0, 20.0, 30.0, 40.0, 60.0])
_parser.add_argument("--samples", type=int, default=100)


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Errors, numbers of cells and times."""
    model = HybridModel.load(options.bundle, load_bundle_mesh(options.bundle))
    prior, newton = model.prior, replace(model.newton, near=None)
    if model.mesh.order == 1 or not isinstance(prior.compliance, ClusteredCompliance):
        raise SystemExit("the bundle has linear cells, or a prior that is not in clusters")
    table = build_sample_table(SimulationStore.open(options.store, mesh=model.mesh))
    contacts = []
    for index in np.unique(np.linspace(0, len(table) - 1, options.samples).astype(int)):
        nodes, displacement = table.contact(int(index))
        if np.isin(nodes, prior.nodes).all():
            contact = prior.hold(nodes)
            contacts.append((contact, contact.solve(displacement.ravel())))

    def timed(step: Callable[[Any, Any], Any]) -> tuple[Any, float]:
        steps, times = [], []
        for contact, force in [contacts[0], *contacts]:
            began = time.perf_counter()
            steps.append(step(contact, force))
            times.append(time.perf_counter() - began)
        return np.array(steps[1:]), 1e3 * float(np.median(times[1:]))

    whole, all_ms = timed(lambda contact, force: newton.step(prior.respond_to_forces(contact, force), contact))
    found: dict[str, Any] = {
        "reach_mm": options.reach, "error_p50": [], "error_p95": [], "cells": [], "ms": [],
        "all_cells": int(model.mesh.deforming_cells.sum()), "all_ms": all_ms, "contacts": len(contacts),
    }
    for reach in options.reach:
        near = NearCells(model.mesh, newton.equilibrium, prior.nodes, reach)
        steps, milliseconds = timed(NearAnswer(replace(newton, near=near)).step)
        error = np.linalg.norm(steps - whole, axis=1) / np.linalg.norm(whole, axis=1)
        found["error_p50"].append(float(np.median(error)))
        found["error_p95"].append(float(np.percentile(error, 95)))
        found["cells"].append(LANES * int(np.median([len(near.around(contact.rows)[0]) for contact, _ in contacts])))
        found["ms"].append(milliseconds)
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    report("near_cells", measure(_parser.parse_args(arguments)))


if __name__ == "__main__":
    main()
