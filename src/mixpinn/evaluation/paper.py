"""The figures of the paper (Yuan et al., MIXPINN), to stand beside measured ones.

They are means over the paper's own test split, with virtual nodes and edges counted (the columns ``as published``).
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class PaperResult:
    """One row of the paper's results, in mm (MSE in mm²)."""

    model: str
    mee: float
    mae: float
    mse: float
    rigid_mee: float
    soft_mee: float
    ree: float


@dataclass(frozen=True)
class PaperAblation:
    """One row of the paper's ablation study: the configuration and its figures."""

    experiment: int
    heads: int
    edge_features: bool
    rigid_edge_loss: bool
    virtual_nodes: bool
    virtual_edges: bool
    result: PaperResult


PAPER_RESULTS = (
    PaperResult("PhysGNN", 0.7358, 0.3593, 0.3604, 0.8209, 0.6864, 0.1238),
    PaperResult("Simple GAT", 0.3847, 0.1905, 0.1266, 0.3874, 0.3831, 0.0723),
    PaperResult("MIXPINN", 0.2588, 0.1304, 0.0670, 0.1663, 0.3126, 0.0326),
)

_ABLATION = (
    # experiment, heads, edge features, REL, VN, VE, then MEE, MAE, MSE, rigid MEE, soft MEE, REE
    (1, 1, False, False, False, False, 0.3847, 0.1905, 0.1266, 0.3874, 0.3831, 0.0723),
    (2, 2, False, False, False, False, 0.3395, 0.1686, 0.1003, 0.3456, 0.3359, 0.0750),
    (3, 2, True, False, False, False, 0.3335, 0.1657, 0.0990, 0.3356, 0.3323, 0.0736),
    (4, 2, True, True, False, False, 0.3259, 0.1616, 0.0961, 0.3418, 0.3166, 0.0636),
    (5, 2, True, False, True, False, 0.2735, 0.1376, 0.0710, 0.1775, 0.3293, 0.0323),
    (6, 2, True, False, False, True, 0.2721, 0.1368, 0.0715, 0.1732, 0.3296, 0.0362),
    (7, 2, True, True, True, False, 0.2759, 0.1386, 0.0724, 0.1794, 0.3320, 0.0256),
    (8, 2, True, True, False, True, 0.2750, 0.1383, 0.0721, 0.1779, 0.3314, 0.0270),
    (9, 2, False, True, False, False, 0.3394, 0.1681, 0.0992, 0.3537, 0.3312, 0.0641),
    (10, 2, False, False, True, False, 0.2588, 0.1304, 0.0670, 0.1663, 0.3126, 0.0326),
    (11, 2, False, False, False, True, 0.2800, 0.1408, 0.0733, 0.1885, 0.3331, 0.0474),
    (12, 2, False, True, True, False, 0.2674, 0.1344, 0.0699, 0.1701, 0.3239, 0.0258),
    (13, 2, False, True, False, True, 0.2830, 0.1424, 0.0737, 0.1888, 0.3377, 0.0348),
)

PAPER_ABLATION = tuple(
    PaperAblation(row[0], row[1], row[2], row[3], row[4], row[5], PaperResult(f"Experiment {row[0]}", *row[6:]))
    for row in _ABLATION
)

PAPER_RUNTIME = {"FEM (SOFA)": 1009.63, "MIXPINN": 73.24}
"""Average time of one deformation [ms], the paper's machine (64-core EPYC, GeForce RTX 4090)."""

PAPER_MESH = (
    ("Soft tissue", 5533, 74896), ("L1", 516, 3372), ("L2", 676, 4634), ("L3", 655, 4350), ("L4", 702, 4766),
    ("L5", 664, 4680), ("Total", 8746, 96698),
)
"""Label, mesh points, directed mesh edges."""

PAPER_DATASET = (
    ("train", 93, 372, 6876), ("validation", 26, 104, 1963), ("test", 13, 52, 957), ("total", 132, 528, 9796),
)
"""Split, probe positions, probe poses, samples."""
