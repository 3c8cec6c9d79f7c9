"""
From simulations to a model that answers at once
================================================

Few simulated poses are enough for the hybrid model: the elastic prior with a learned correction. It says how far to
trust it, and can be refined until it agrees with the solver.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import mixpinn as mx
from mixpinn.anatomy import tiny_phantom
from mixpinn.dataset import TINY, grid_positions, plan_poses, probe_path, table_of
from mixpinn.fem import PAPER_TISSUE, simulate_pose
from mixpinn.reduced.fit import HybridConfig, fit_hybrid
from mixpinn.reduced.prior import ElasticPrior
from mixpinn.serving import HybridPredictor

mesh = mx.make_mesh(tiny_phantom(), size=4.0)
scene = mx.Scene(mesh, mx.linear_probe(length=40.0), (PAPER_TISSUE,))
protocol = replace(TINY, rotations=(0.0,), max_positions=10)
positions = grid_positions(mesh, protocol)
poses = plan_poses(positions, protocol, mesh=mesh, probe=scene.probe, gap=scene.contact.gap)
table = table_of([
    simulate_pose(
        scene, probe_path(pose.position, 0.0, protocol), position_index=pose.position_index, rotation_deg=0.0,
    )
    for pose in poses
])

# %%
# Seven positions to learn from, two to calibrate the error estimate, one to try.

prior = ElasticPrior.build(mesh, scene.materials)
train, validation, test = (table.at_positions(numbers) for numbers in (range(7), (7, 8), (9,)))
model = fit_hybrid(prior, scene.materials, train, validation, HybridConfig(modes=8, coordinates=3))

# %%
# It is given the displacement of the contact nodes of a pose that it has never seen. ``model.save(folder)`` writes it,
# ``HybridPredictor.load(folder)`` reads it back.

predictor = HybridPredictor(model)
sample = test[len(test) - 1]
answer = predictor.predict_at(sample.contact_nodes, sample.contact_displacement)
error = np.linalg.norm(answer.displacement - sample.displacement, axis=1).mean()
trust = predictor.assess(sample.contact_nodes, sample.contact_displacement)
print(f"mean error {error:.4f} mm; expected {trust.expected:.4f} mm, 95 % below {trust.bound:.4f} mm")

# %%
# **Check.** Newton steps of the true solver carry the answer to the solver's own: after four of them the difference is
# what single precision leaves.

refined, residuals = predictor.refine(sample.contact_nodes, sample.contact_displacement, 4)
left = np.linalg.norm(refined.displacement - sample.displacement, axis=1).mean()
print(f"after four Newton steps {left:.1e} mm; unbalanced force {residuals[0]:.1e} -> {residuals[-1]:.1e}")
assert left < 1e-4
assert left < 0.01 * error

figure, axes = plt.subplots(figsize=(5.0, 3.2), layout="constrained")
axes.semilogy(residuals, "o-")
axes.set(xlabel="Newton step", ylabel="unbalanced force, relative")
