"""MIXPINN's network on top of the elastic prior: the prior's field goes in, what the prior misses is to come out.

``python -m benchmarks.hybrid_network STORE --split SPLIT.json --out DIR`` trains MIXPINN (8 layers, 2 heads, virtual
nodes) on a share of the training samples for a budget of minutes, tests it on the test positions and leaves
``network.json`` in DIR, beside the parts of ``benchmarks.hybrid_study``. The network reads the prior's displacement of
every node in place of the contact displacement, which it contains.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np

from benchmarks.history import report
from benchmarks.hybrid_study import Study, measure
from mixpinn.base.arrays import AnyArray, Float32Array
from mixpinn.base.files import write_json
from mixpinn.graph import Scaling
from mixpinn.networks import MIXPINN
from mixpinn.records import SampleTable
from mixpinn.reduced.prior import ElasticPrior
from mixpinn.serving import Predictor
from mixpinn.stages.training import train_network
from mixpinn.training import TrainConfig


@dataclass(frozen=True, eq=False)
class MissedTable(SampleTable):
    """Samples whose input is the prior's field and whose target is what the prior misses.

    Attributes:
        response: the prior's displacement of every node [mm], shape (N, n, 3).
    """

    response: Float32Array = field(default_factory=lambda: np.empty(0, np.float32))

    @staticmethod
    def of(table: SampleTable, prior: ElasticPrior) -> "MissedTable":
        """Ask the prior about every sample."""
        response = np.stack([prior.predict(*table.contact(index)) for index in range(len(table))])
        values = {entry.name: getattr(table, entry.name) for entry in fields(SampleTable)}
        return MissedTable(**{**values, "displacement": table.displacement - response}, response=response)

    def contact_field(self, index: int) -> Float32Array:
        """The network's input [mm], shape (n, 3)."""
        return self.response[index]


@dataclass(frozen=True, eq=False)
class PriorNetwork:
    """Prior and network together."""

    prior: ElasticPrior
    network: Predictor
    name: str = "Prior + MIXPINN's network on the rest"

    def predict(self, nodes: AnyArray, displacements: AnyArray) -> Float32Array:
        """Displacement of every node [mm], shape (n, 3)."""
        response = self.prior.predict(nodes, displacements)
        return response + self.network.predict(np.arange(len(response)), response)


def main(arguments: Sequence[str] | None = None) -> None:
    """Train, test, print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hybrid_network", description=__doc__)
    parser.add_argument("store", type=Path)
    parser.add_argument("--split", required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--every", type=int, default=6, help="one of so many training samples")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--width", default="desk")
    options = parser.parse_args(arguments)
    study = Study.of(options.store, options.split)
    train = study.table.select(study.train[:: options.every])
    validation = study.table.at_positions(study.split.validation)
    validation = validation.select(np.arange(0, len(validation), 10))
    folder = options.out / "network"
    result = train_network(
        study.mesh, MissedTable.of(train, study.prior), MissedTable.of(validation, study.prior),
        replace(MIXPINN.with_width(options.width), scaling=Scaling.STANDARD),
        TrainConfig(learning_rate=2e-3, decay_patience=2, threads=options.threads, time_budget=60.0 * options.minutes),
        out=folder,
    )
    model = PriorNetwork(study.prior, Predictor.load(folder, threads=options.threads))
    rows = measure([model], study.table.at_positions(study.split.test), study.mesh, "test")
    rows[0] |= {"training_samples": len(train), "epochs": len(result.history), "seconds": result.seconds}
    write_json(options.out / "network.json", rows)
    report("hybrid_network", rows, kept=rows[0])


if __name__ == "__main__":
    main()
