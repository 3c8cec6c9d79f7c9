"""Products of torch do not change because the sparse solver was used in the same process."""

import subprocess
import sys

import pytest

pytest.importorskip("pypardiso")

SCRIPT = """
import sys
import numpy as np, scipy.sparse as sp, torch
from mixpinn.fem import PardisoSolver
from mixpinn.training import settle_arithmetic
settle_arithmetic()
if sys.argv[1] == "solver":
    solver = PardisoSolver(threads=1)
    solver.factorize(sp.csr_matrix(sp.eye(50) * 4.0))
    solver.solve(np.ones(50))
torch.set_num_threads(1)
generator = torch.Generator().manual_seed(0)
for rows, inner, columns in ((500, 16, 6), (16, 500, 16), (508, 16, 16), (127, 14, 16)):
    product = torch.randn(rows, inner, generator=generator) @ torch.randn(inner, columns, generator=generator)
    print(product.double().sum().item().hex(), product.abs().max().item().hex())
"""


def test_the_solver_leaves_products_as_they_are():
    printed = [
        subprocess.run(
            [sys.executable, "-c", SCRIPT, mode], capture_output=True, text=True, timeout=120, check=True,
        ).stdout
        for mode in ("alone", "solver")
    ]
    assert printed[0] == printed[1]
    assert len(printed[0].splitlines()) == 4
