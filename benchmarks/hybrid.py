"""The hybrid model's bars: errors on the test positions of its own simulations, latency, and the pose alone.

``python -m benchmarks.hybrid BUNDLE`` reads the store and the split that the bundle was made from (or ``--store``),
predicts every test sample and prints the errors of prior and hybrid model and, as its last line, a JSON object. Latency
is the wall time of one prediction, warm, from the displacements of the contact nodes to those of all nodes.
"""

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.history import report

if TYPE_CHECKING:
    from mixpinn.press.model import PoseModel
    from mixpinn.records import SampleTable

_parser = argparse.ArgumentParser(prog="python -m benchmarks.hybrid", description=__doc__)
_parser.add_argument("bundle", type=Path)
_parser.add_argument("--store", type=Path, help="simulations, where they have moved")
_parser.add_argument("--threads", type=int, default=2)


def measure(bundle: Path, store: Path | None, threads: int) -> dict[str, Any]:
    """All figures of one bundle."""
    import numpy as np

    from mixpinn.base.files import read_json
    from mixpinn.dataset import SimulationStore, Split, build_sample_table
    from mixpinn.evaluation import evaluate
    from mixpinn.records.answer import discretisation_of
    from mixpinn.serving import HybridPredictor

    beside = bundle.parent / "simulation" / "store"  # of a run of 'mixpinn onboard'
    if store is None and (beside / "store.json").is_file():
        store = beside
    opened = SimulationStore.open(store or Path(read_json(bundle / "run.json")["input_paths"]["store"]).parent)
    split = Split.load(bundle / "split.json")
    table = build_sample_table(opened).at_positions(split.test)
    predictor = HybridPredictor.load(bundle, threads=threads)
    prior = evaluate(predictor.model.prior, table, predictor.mesh, split="test", warm_up=20)
    hybrid = evaluate(predictor, table, predictor.mesh, split="test", warm_up=20)
    for found in (prior, hybrid):
        mee = found.metrics["mee"]
        print(
            f"{found.model}: MEE {mee.mean():.4f} mm, 95th percentile {np.quantile(mee, 0.95):.4f}, worst "
            f"{mee.max():.4f}; median {1e3 * np.median(found.seconds):.2f} ms"
        )
    mee, milliseconds = hybrid.metrics["mee"], 1e3 * hybrid.seconds
    return {
        **(pose_figures(predictor.pose, table) if predictor.pose is not None else {}),
        "samples": len(table), "mee": float(mee.mean()), "rigid_mee": float(hybrid.metrics["rigid_mee"].mean()),
        "soft_mee": float(hybrid.metrics["soft_mee"].mean()), "ree": float(hybrid.metrics["ree"].mean()),
        "mee_p95": float(np.quantile(mee, 0.95)), "mee_max": float(mee.max()),
        "latency_ms_p50": float(np.median(milliseconds)), "latency_ms_p99": float(np.quantile(milliseconds, 0.99)),
        "prior_mee": float(prior.metrics["mee"].mean()), "loading_seconds": predictor.loading_seconds,
        "threads": threads, "nodes": predictor.mesh.n_points, "discretisation": discretisation_of(predictor.mesh),
    }


def pose_figures(model: "PoseModel", table: "SampleTable") -> dict[str, Any]:
    """Errors and latency from the pose alone."""
    from benchmarks.pose import by_model, latency, score

    found = score(by_model(model, table), table, model.hybrid.prior.coordinates)
    print("From the pose: " + ", ".join(f"{name} {value:.4f}" for name, value in found.items()))
    return {
        "pose_mee": found["mee"], "pose_rigid_mee": found["rigid_mee"], "pose_mee_p95": found["mee_p95"],
        **{name: value for name, value in found.items() if name.startswith(("vertebra", "force"))},
        **latency(model, table, 400),
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    options = _parser.parse_args(arguments)
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(name, str(options.threads))  # before the libraries are loaded
    report("hybrid", measure(options.bundle, options.store, options.threads))


if __name__ == "__main__":
    main()
