"""
A force controller at 100 Hz
============================

A robot that holds a probe wants a force, not a depth. Its controller asks the predictor a hundred times a second how
hard the tissue pushes back; friction remembers the way. Here the tissue is the small phantom under a ball, with nothing
learned: the elastic prior and contact alone.
"""

import matplotlib.pyplot as plt
import numpy as np

import mixpinn as mx
from mixpinn.anatomy import tiny_phantom
from mixpinn.fem import DEFAULT_TISSUE
from mixpinn.reduced.equilibrium import Equilibrium
from mixpinn.reduced.hybrid import HybridModel
from mixpinn.reduced.prior import ElasticPrior
from mixpinn.serving import HybridPredictor
from mixpinn.stages.hybrid import plain_pose_model

mesh = mx.make_mesh(tiny_phantom(), size=4.0)
prior = ElasticPrior.build(mesh, [DEFAULT_TISSUE])
model = HybridModel.of_prior(prior, Equilibrium.of_materials(mesh, [DEFAULT_TISSUE]))
probe = mx.spherical_probe(radius=15.0, subdivisions=3)
predictor = HybridPredictor(model, pose=plain_pose_model(model, probe, mx.ContactConfig()))

# %%
# A fitted bundle would be loaded in one line: ``predictor = mx.load("runs/hybrid")``. The stiffness at a first guess of
# the pose tells the gain of the controller: how far to go for a newton that is missing.

wanted, period = 3.0, 0.01
tip = np.array([0.0, mesh.points[:, 1].max() - 2.0, 0.0])
axis = np.array([0.0, -1.0, 0.0])
normal_stiffness = abs(predictor.stiffness(tip)[1, 1])
gain = 10.0 / normal_stiffness  # mm a second for each newton: the error falls by e in a tenth of a second

# %%
# The loop. The command is a speed along the axis, at most 40 mm a second; each answer carries the history to the next.

times, forces, history = [], [], None
for step in range(120):
    answer = predictor.press(tip, history=history)
    history = answer.history
    force = float(np.linalg.norm(answer.force))
    times.append(step * period)
    forces.append(force)
    speed = np.clip(gain * (wanted - force), -40.0, 40.0)
    tip = tip + speed * period * axis

figure, plot = plt.subplots(figsize=(7.0, 3.0))
plot.plot(times, forces)
plot.axhline(wanted, linestyle="--", color="grey")
plot.set(xlabel="time [s]", ylabel="force [N]")
figure.tight_layout()
plt.show()

# %%
# **Check.** The controller ends where the depth for that force is: two ways to the same pose. Contact of a coarse mesh
# with friction depends a little on the way, hence the tolerance.

found = predictor.depth_for(wanted, tip)
apart = abs(float((tip - found.tip) @ axis))
print(f"force {forces[-1]:.3f} N of {wanted:g} N; {apart:.3f} mm from the depth for that force, which took "
      f"{found.solves} answers")
assert abs(forces[-1] - wanted) < 0.02
assert apart < 0.3
