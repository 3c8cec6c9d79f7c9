"""ModelConfig: which network, on which graph, with which loss; the rows of the paper's tables."""

import dataclasses
import math
from dataclasses import dataclass
from typing import Literal

from mixpinn.base.errors import InputError
from mixpinn.graph import Scaling

WIDTHS = {"tiny": 8, "desk": 32, "authors": 128, "paper": 256}
"""Channels a head by name: `authors` made the paper's tables, `paper` is what its text says."""


@dataclass(frozen=True)
class ModelConfig:
    """A model of the tables.

    Attributes:
        architecture: graph attention (MIXPINN and the simple GAT) or PhysGNN.
        layers: attention layers.
        heads: heads a layer.
        hidden: channels a head; for PhysGNN channels of the convolutions.
        edge_features: whether attention reads edge features.
        virtual_nodes: whether the graph has virtual nodes.
        virtual_edges: whether the graph has virtual edges.
        rel_weight: weight of the Rigid Edge Loss beside the mean Euclidean error; 0 leaves it out.
        scaling: scaling of inputs and outputs.

    Raises:
        InputError: a number that makes no network.
    """

    architecture: Literal["gat", "physgnn"] = "gat"
    layers: int = 8
    heads: int = 2
    hidden: int = 128
    edge_features: bool = False
    virtual_nodes: bool = False
    virtual_edges: bool = False
    rel_weight: float = 0.0
    scaling: Scaling = Scaling.NONE

    def __post_init__(self) -> None:
        for name, least, most in (("layers", 1, 1_000), ("heads", 1, 1_000), ("hidden", 1, 100_000)):
            if not least <= getattr(self, name) <= most:
                raise InputError(
                    f"model.{name}", expected=f"at least {least}, at most {most:,}", got=str(getattr(self, name)),
                    fix="correct the setting",
                )
        if not 0.0 <= self.rel_weight < math.inf:
            raise InputError(
                "model.rel_weight", expected="at least 0", got=str(self.rel_weight), fix="correct the setting",
            )

    def with_width(self, width: str) -> "ModelConfig":
        """The same model at one of the named `WIDTHS`; PhysGNN keeps its own.

        Raises:
            InputError: an unknown width.
        """
        if width not in WIDTHS:
            raise InputError("width", expected="one of " + ", ".join(WIDTHS), got=repr(width), fix="choose one of them")
        return self if self.architecture == "physgnn" else dataclasses.replace(self, hidden=WIDTHS[width])


def _row(heads: int, edge_features: int, rel: int, virtual_nodes: int, virtual_edges: int) -> ModelConfig:
    return ModelConfig(
        heads=heads, edge_features=bool(edge_features), rel_weight=float(rel), virtual_nodes=bool(virtual_nodes),
        virtual_edges=bool(virtual_edges),
    )


ABLATION: dict[int, ModelConfig] = {
    #      heads, edge features, REL, VN, VE
    1: _row(1, 0, 0, 0, 0),
    2: _row(2, 0, 0, 0, 0),
    3: _row(2, 1, 0, 0, 0),
    4: _row(2, 1, 1, 0, 0),
    5: _row(2, 1, 0, 1, 0),
    6: _row(2, 1, 0, 0, 1),
    7: _row(2, 1, 1, 1, 0),
    8: _row(2, 1, 1, 0, 1),
    9: _row(2, 0, 1, 0, 0),
    10: _row(2, 0, 0, 1, 0),
    11: _row(2, 0, 0, 0, 1),
    12: _row(2, 0, 1, 1, 0),
    13: _row(2, 0, 1, 0, 1),
}
"""The paper's ablation table: configuration by row number, at width `authors`."""

SIMPLE_GAT = ABLATION[1]
MIXPINN = ABLATION[10]
PHYSGNN = ModelConfig(architecture="physgnn", hidden=112)

MODELS: dict[str, ModelConfig] = {
    "mixpinn": MIXPINN, "simple-gat": SIMPLE_GAT, "physgnn": PHYSGNN,
    **{f"row-{number}": config for number, config in ABLATION.items()},
}
"""Configurations by name."""
