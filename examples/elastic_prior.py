"""
The elastic prior: exact to first order
=======================================

The elastic prior is the linear answer of the body to a displacement of its skin, from one factorization and without
training. What it misses is of second order: half the displacement, a quarter of the error.
"""

import matplotlib.pyplot as plt
import numpy as np

import mixpinn as mx
from mixpinn.anatomy import tiny_phantom
from mixpinn.fem import PAPER_TISSUE, ElasticSystem, SolverConfig, solve_imposed
from mixpinn.reduced.prior import ElasticPrior

mesh = mx.make_mesh(tiny_phantom(), size=4.0)
prior = ElasticPrior.build(mesh, [PAPER_TISSUE])

# %%
# Skin around one node of the back is pushed in, the more the nearer it is. The solver finds the true answer for pushes
# of 4, 2, 1 and 0.5 mm.

tip = prior.nodes[np.argmin(np.linalg.norm(mesh.points[prior.nodes][:, [0, 2]], axis=1))]
distance = np.linalg.norm(mesh.points[prior.nodes] - mesh.points[tip], axis=1)
nodes = prior.nodes[distance < 25.0]
shape = np.zeros((len(nodes), 3))
shape[:, 1] = -np.exp(-((distance[distance < 25.0] / 20.0) ** 2))

pushes = np.array([0.5, 1.0, 2.0, 4.0])
truth = solve_imposed(
    ElasticSystem(mesh, [PAPER_TISSUE]), [(nodes, push * shape) for push in pushes],
    config=SolverConfig(tolerance=1e-10),
).displacement
errors = []
for push, exact in zip(pushes, truth, strict=True):
    errors.append(np.linalg.norm(prior.predict(nodes, push * shape) - exact, axis=1).mean())

figure, axes = plt.subplots(figsize=(5.0, 3.5), layout="constrained")
axes.loglog(pushes, errors, "o-", label="elastic prior")
axes.loglog(pushes, errors[-1] * (pushes / pushes[-1]) ** 2, "k:", label="second order")
axes.set(xlabel="push [mm]", ylabel="mean error [mm]")
axes.legend(frameon=False)

# %%
# **Check.** The order is two.

order = np.log2(errors[2] / errors[1])
print(f"errors {np.array(errors)} mm, order {order:.2f}")
assert 1.8 < order < 2.3
