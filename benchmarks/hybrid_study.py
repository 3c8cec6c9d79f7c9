"""The hybrid model against its alternatives, with less data, on what it has not seen, and how far its error is known.

``python -m benchmarks.hybrid_study STORE --split SPLIT.json --out DIR`` takes a store of the paper's protocol, runs the
parts that DIR does not hold yet (each leaves one JSON there) and prints a table of each. `--part` chooses parts; the
hold-out of another probe needs `--other-probe STORE`, the comparison with recordings `--sofa STORE`.
"""

import argparse
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from benchmarks.history import report
from mixpinn.base.arrays import AnyArray
from mixpinn.base.files import read_json, write_json
from mixpinn.dataset import SimulationStore, Split, build_sample_table, deeper_than, rotation_is
from mixpinn.evaluation import ZeroModel, evaluate
from mixpinn.fem import PAPER_TISSUE
from mixpinn.records import Evaluation, SampleTable, TissueMesh
from mixpinn.reduced.equilibrium import Equilibrium
from mixpinn.reduced.error_estimate import ErrorEstimate
from mixpinn.reduced.fit import HybridConfig, PreparedSamples, error_signs, fit_correction, prepare_samples
from mixpinn.reduced.hybrid import HybridModel
from mixpinn.reduced.newton_steps import NewtonSteps
from mixpinn.reduced.prior import ElasticPrior, probed_nodes
from mixpinn.stages.samples import SplitConfig, load_samples

MATERIALS = [PAPER_TISSUE]
RIDGE_ONLY = HybridConfig(newton=False, coordinates=16)
STEP_ONLY = HybridConfig(response=False)


@dataclass(frozen=True, eq=False)
class Study:
    """One store with its split; what several parts need is made once."""

    table: SampleTable
    split: Split
    mesh: TissueMesh
    prior: ElasticPrior

    @staticmethod
    def of(store: Path, split: str, *, further: Path | None = None) -> "Study":
        """Read a store; the prior is prepared for its contact nodes and those of a `further` store."""
        opened = SimulationStore.open(store)
        table, parts = load_samples(opened, SplitConfig(file=split))
        nodes = np.union1d(probed_nodes(opened.mesh()), table.contact_nodes)
        if further is not None:
            nodes = np.union1d(nodes, build_sample_table(SimulationStore.open(further)).contact_nodes)
        return Study(table, parts, opened.mesh(), ElasticPrior.build(opened.mesh(), MATERIALS, nodes=nodes))

    @cached_property
    def train(self) -> AnyArray:
        """Indices of the training samples."""
        return np.flatnonzero(np.isin(self.table.position_index, self.split.train))

    @cached_property
    def prepared(self) -> PreparedSamples:
        """The training samples as the physical models see them."""
        equilibrium = Equilibrium.of_materials(self.mesh, MATERIALS)
        newton = HybridModel.of_prior(self.prior, equilibrium).newton
        return prepare_samples(self.prior, newton, self.table.select(self.train))

    def fit(
        self, chosen: AnyArray | None = None, config: HybridConfig | None = None, name: str = "Hybrid",
    ) -> HybridModel:
        """The model from the training samples `chosen` (a mask over them), or from all."""
        prepared = self.prepared if chosen is None else self.prepared.select(chosen)
        return replace(fit_correction(self.prior, MATERIALS, prepared, config or HybridConfig()), name=name)


def figures(evaluation: Evaluation) -> dict[str, Any]:
    """Means over samples, the tail, and the latency."""
    mee = evaluation.metrics["mee"]
    return {
        "model": evaluation.model, "samples": len(mee), "mee": float(mee.mean()), "mee_std": float(mee.std()),
        "rigid_mee": float(evaluation.metrics["rigid_mee"].mean()),
        "soft_mee": float(evaluation.metrics["soft_mee"].mean()), "ree": float(evaluation.metrics["ree"].mean()),
        "mee_p95": float(np.quantile(mee, 0.95)), "mee_max": float(mee.max()),
        "milliseconds": 1e3 * float(np.median(evaluation.seconds)),
    }


def measure(models: Sequence[Any], table: SampleTable, mesh: TissueMesh, split: str) -> list[dict[str, Any]]:
    """Every model on the same samples."""
    return [figures(evaluate(model, table, mesh, split=split)) for model in models]


def variants(study: Study) -> list[dict[str, Any]]:
    """What was tried, on the test positions."""
    plain = study.fit(config=STEP_ONLY)
    bare = np.zeros_like(plain.gain)
    bare[: len(plain.newton.modes)] = np.eye(len(plain.newton.modes))
    models = [
        ZeroModel(study.mesh.n_points), study.prior, study.fit(config=RIDGE_ONLY, name="Prior + quadratic ridge"),
        *(NewtonSteps(study.prior, MATERIALS, steps=k) for k in (1, 2, 3)),
        replace(plain, gain=bare, name="Prior + modal Newton step, no regression"),
        replace(plain, name="Prior + modal Newton step + linear ridge"), study.fit(name="Hybrid"),
        *(study.fit(config=HybridConfig(modes=m), name=f"Hybrid, {m} modes") for m in (24, 48, 192)),
    ]
    return measure(models, study.table.at_positions(study.split.test), study.mesh, "test")


def data_need(study: Study) -> list[dict[str, Any]]:
    """Errors against the number of training positions, the first ones of the split's permutation."""
    test = study.table.at_positions(study.split.test)
    order = np.random.default_rng(42).permutation(len(np.unique(study.table.position_index)))
    order = order[np.isin(order, study.split.train)]
    found = []
    for count in (12, 24, 48, len(study.split.train)):
        mask = np.isin(study.prepared.position, order[:count])
        for config, name in ((None, "Hybrid"), (RIDGE_ONLY, "Prior + quadratic ridge")):
            row, = measure([study.fit(mask, config, name)], test, study.mesh, "test")
            found.append({"positions": count, "training_samples": int(mask.sum()), **row})
    return found


def hold_outs(study: Study, other_probe: Path | None) -> list[dict[str, Any]]:
    """What the model has never seen: a rotation, depth, another probe; at positions it was not fitted on."""
    unseen = study.table.at_positions(np.union1d(study.split.test, study.split.validation))
    ridge = study.fit(config=RIDGE_ONLY, name="Prior + quadratic ridge")
    found = []
    train = study.table.select(study.train)
    for name, selector in (("rotation-135", rotation_is(135.0)), ("deep", deeper_than(15.0))):
        kept = ~selector(train)
        models = [study.prior, study.fit(kept, RIDGE_ONLY, ridge.name), study.fit(kept)]
        test = unseen.select(selector(unseen))
        poses = len(np.unique(np.stack([test.position_index, test.rotation_deg]), axis=1).T)
        found += [{"hold_out": name, "poses": poses, **row} for row in measure(models, test, study.mesh, name)]
    if other_probe is not None:
        store = SimulationStore.open(other_probe, mesh=study.mesh)
        test = build_sample_table(store)
        models = [study.prior, ridge, study.fit()]
        found += [
            {"hold_out": "probe", "poses": len(store.poses), **row}
            for row in measure(models, test, study.mesh, "probe")
        ]
    return found


def error_estimate(study: Study, folds: int = 4) -> list[dict[str, Any]]:
    """How well the estimate ranks and bounds errors, cross-fitted over validation and test positions."""
    unseen = study.table.at_positions(np.union1d(study.split.test, study.split.validation))
    model = study.fit()
    signs, errors = error_signs(model, unseen)
    milliseconds = _assessment_time(model, unseen)
    trained = study.prepared.coordinates(model.readers)
    fold = np.searchsorted(np.unique(unseen.position_index), unseen.position_index) % folds
    expected = np.empty(len(unseen))
    rows = []
    for left in range(folds):
        inside, out = np.flatnonzero(fold != left), np.flatnonzero(fold == left)
        estimate = ErrorEstimate.fit([signs[i] for i in inside], errors[inside], training_coordinates=trained)
        expected[out] = [estimate.expected(signs[i]) for i in out]
        covered = [estimate.bound(signs[i]) >= errors[i] for i in out]
        rows.append({
            "fold": left, "samples": len(out), "coverage": float(np.mean(covered)),
            "bound_over_error": float(np.median([estimate.bound(signs[i]) / errors[i] for i in out])),
            "outside": float(np.mean([estimate.outside(signs[i]) for i in out])),
        })
    within = [
        float(spearmanr(expected[unseen.depth == d], errors[unseen.depth == d]).statistic)
        for d in np.unique(unseen.depth) if (unseen.depth == d).sum() >= 20
    ]
    weights = [int((unseen.depth == d).sum()) for d in np.unique(unseen.depth) if (unseen.depth == d).sum() >= 20]
    return [{
        "fold": "all", "samples": len(unseen), "spearman": float(spearmanr(expected, errors).statistic),
        "spearman_fixed_depth": float(np.average(within, weights=weights)),
        "spearman_fixed_depth_least": min(within), "milliseconds": milliseconds,
    }, *rows]


def _assessment_time(model: HybridModel, table: SampleTable) -> float:
    seconds = []
    for index in range(0, len(table), max(1, len(table) // 60)):
        sample = table[index]
        state = model.solve(sample.contact_nodes, sample.contact_displacement)
        began = time.perf_counter()
        model.signs(state)
        seconds.append(time.perf_counter() - began)
    return 1e3 * float(np.median(seconds))


def recordings(study: Study, sofa: Path) -> list[dict[str, Any]]:
    """SOFA's recordings: fitted on their own training positions, and on our simulations at those positions alone."""
    theirs = Study.of(sofa, "every-fifth")
    test = theirs.table.at_positions(theirs.split.test)
    both = np.union1d(theirs.split.train, theirs.split.validation)
    everything = replace(theirs, split=Split("every-fifth", both, theirs.split.validation[:0], theirs.split.test))
    apart = ~np.isin(study.prepared.position, theirs.split.test)
    models = [
        theirs.prior, everything.fit(config=RIDGE_ONLY, name="Prior + quadratic ridge, SOFA"),
        everything.fit(name="Hybrid, fitted on SOFA"), study.fit(apart, name="Hybrid, fitted on own simulations"),
    ]
    return measure(models, test, study.mesh, "SOFA")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the parts that are missing, and print all."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hybrid_study", description=__doc__)
    parser.add_argument("store", type=Path)
    parser.add_argument("--split", required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--part", action="append", choices=("variants", "data", "hold-outs", "error", "sofa"))
    parser.add_argument("--other-probe", type=Path)
    parser.add_argument("--sofa", type=Path)
    options = parser.parse_args(arguments)
    parts: dict[str, Callable[[Study], list[dict[str, Any]]]] = {
        "variants": variants, "data": data_need, "hold-outs": lambda s: hold_outs(s, options.other_probe),
        "error": error_estimate,
    }
    if options.sofa is not None:
        parts["sofa"] = lambda s: recordings(s, options.sofa)
    study: Study | None = None
    for name in options.part or parts:
        file = options.out / f"{name}.json"
        fresh = not file.exists()
        if fresh:
            study = study or Study.of(options.store, options.split, further=options.sofa)
            write_json(file, parts[name](study))
        print(name)
        for row in read_json(file):
            print("  " + json.dumps({k: round(v, 4) if isinstance(v, float) else v for k, v in row.items()}))
        if fresh:
            report("hybrid_study", read_json(file), kept={
                f"{name}, {row['model']}, MEE [mm]": row["mee"] for row in read_json(file) if "mee" in row
            })


if __name__ == "__main__":
    main()
