"""
One's own tissue
================

Stiffness is a matter of two constants. Each label of the mesh may have its own; here one tissue is made twice as stiff
as another, and everything else is left alone.
"""

import matplotlib.pyplot as plt
import numpy as np

import mixpinn as mx
from mixpinn.anatomy import tiny_phantom

mesh = mx.make_mesh(tiny_phantom(), size=4.0)
back = mesh.points[:, 1].max()

# %%
# Contact is a stiff spring. It is made stiffer together with the tissue here, so that the two problems differ by one
# factor alone.


def pressing_forces(factor):
    """Force that the skin exerts on the probe at each depth [N], with all stiffnesses multiplied by `factor`."""
    tissue = mx.StableNeoHookean.from_young(factor * 25.4e-3, 0.45)  # [N/mm²]
    contact = mx.ContactConfig(stiffness=factor * mx.ContactConfig().stiffness)
    scene = mx.Scene(mesh, mx.linear_probe(length=40.0), (tissue,), contact=contact)
    forces, history = [], None
    for depth in depths:
        answer = mx.solve_pose(scene, tip=(0.0, back - depth, 0.0), history=history)
        forces.append(answer.force[1])
        history = answer.history
    return np.array(forces)


depths = np.array([0.0, 1.0, 2.0, 3.0])  # of the tip below the hindmost point of the skin [mm]
soft, stiff = pressing_forces(1.0), pressing_forces(2.0)
figure, axes = plt.subplots(figsize=(5.0, 3.5), layout="constrained")
axes.plot(depths, soft, "o-", label="E = 25.4 kPa")
axes.plot(depths, stiff, "o-", label="twice as stiff")
axes.set(xlabel="depth [mm]", ylabel="force [N]")
axes.legend(frameon=False)

# %%
# **Check.** Equilibrium knows no other scale of stress: twice the stiffness, twice the force.

print(f"{soft[-1]:.4f} N and {stiff[-1]:.4f} N")
assert abs(stiff[-1] / soft[-1] - 2.0) < 1e-5
