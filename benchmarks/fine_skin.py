"""Whether forces from the probe's pose scatter less on finer skin than on the model's own faces.

``python -m benchmarks.fine_skin BUNDLE --store STORE`` presses as the simulated poses of a store do and compares forces
along the probe with the simulated ones, before anything is learned about forces: the standard deviation over poses of
the logarithm of their ratio, at each of some steps. A ratio that is the same at all poses could be learned from one;
what scatters cannot. Times are those of one answer of each.

The last line is a JSON object: ``steps``, ``own_scatter``, ``fine_scatter``, ``poses``, ``fine_ms_p50``,
``contact_ms_p50``.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.history import report
from mixpinn.dataset import SimulationStore
from mixpinn.geometry.probe_pose import PROBE_AXIS
from mixpinn.press.files import load_pose_model
from mixpinn.reduced.hybrid import HybridModel, load_bundle_mesh

STEPS = (0, 1, 2, 4, 9, 14, 19)

_parser = argparse.ArgumentParser(description=__doc__)
_parser.add_argument("bundle", type=Path)
_parser.add_argument("--store", type=Path, required=True, help="simulations, of the bundle's mesh")


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Scatter of both, step by step."""
    model = load_pose_model(options.bundle, HybridModel.load(options.bundle, load_bundle_mesh(options.bundle)))
    if model.fine is None:
        raise SystemExit("the bundle has no finer skin: its simulations were not refined under the probe")
    plain = replace(model, law=None, correction=None, error=None)
    store = SimulationStore.open(options.store, mesh=model.hybrid.mesh)
    ratios, times = [], []
    for pose in store.poses:
        if store.status(pose).state != "done":
            continue
        simulated, row = store.load(pose), []
        for step in STEPS:
            if not simulated.converged[step]:
                row.append((np.nan, np.nan))
                continue
            turn, tip = simulated.path.rotations[step][None], simulated.path.translations[step][None]
            true = -float(simulated.probe_wrench[step, :3] @ (turn[0] @ PROBE_AXIS))
            began = time.perf_counter()
            contact = plain.touch(turn, tip).contact
            between = time.perf_counter()
            fine = float(model.fine.push(model.probes[:1], turn, tip)[0])
            times.append((between - began, time.perf_counter() - between))
            own = -float(contact.wrench[0, :3] @ (turn[0] @ PROBE_AXIS))
            row.append(tuple(np.log(max(found, 1e-3) / max(true, 1e-3)) for found in (own, fine)))
        ratios.append(row)
    scatter = np.nanstd(np.array(ratios), axis=0)
    for step, (own, fine) in zip(STEPS, scatter, strict=True):
        print(f"step {step + 1:2d}: own faces {100.0 * own:5.1f} %, finer skin {100.0 * fine:5.1f} %")
    contact_ms, fine_ms = 1e3 * np.median(times, axis=0)
    return {
        "steps": [step + 1 for step in STEPS], "own_scatter": scatter[:, 0].tolist(),
        "fine_scatter": scatter[:, 1].tolist(), "poses": len(ratios), "fine_ms_p50": float(fine_ms),
        "contact_ms_p50": float(contact_ms),
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    report("fine_skin", measure(_parser.parse_args(arguments)))


if __name__ == "__main__":
    main()
