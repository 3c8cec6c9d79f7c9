"""
One's own network
=================

Whatever turns the displacement of the contact nodes into the displacement of all nodes can be evaluated beside the
models of the paper. This one is a small network on the mesh's edges in plain PyTorch: it averages over neighbours and
is trained for a few seconds.
"""

from dataclasses import replace
from itertools import pairwise

import matplotlib.pyplot as plt
import numpy as np
import torch

import mixpinn as mx
from mixpinn.anatomy import tiny_phantom
from mixpinn.dataset import TINY, grid_positions, plan_poses, probe_path, table_of
from mixpinn.evaluation import ZeroModel, evaluate
from mixpinn.fem import simulate_pose

mesh = mx.make_mesh(tiny_phantom(), size=4.0)
scene = mx.Scene(mesh, mx.linear_probe(length=40.0))
protocol = replace(TINY, rotations=(0.0,), max_positions=2)
positions = grid_positions(mesh, protocol)
simulations = [
    simulate_pose(scene, probe_path(pose.position, 0.0, protocol), position_index=pose.position_index, rotation_deg=0.0)
    for pose in plan_poses(positions, protocol, mesh=mesh, probe=scene.probe, gap=scene.contact.gap)
]
table = table_of(simulations)

# %%
# The network: node features through layers that add the mean over the neighbours.


class Averaging(torch.nn.Module):
    """Reads (n, 3) contact displacements [mm], writes (n, 3) displacements [mm]."""

    name = "Averaging"

    def __init__(self, mesh, width=16, layers=4):
        super().__init__()
        ends = np.concatenate([mesh.edges, mesh.edges[:, ::-1]])
        self.to, self.of = (torch.tensor(column) for column in ends.T)
        self.count = torch.bincount(self.to, minlength=mesh.n_points)[:, None]
        self.place = torch.tensor(mesh.points / 100.0, dtype=torch.float32)
        sizes = [6, *[width] * layers]
        self.own = torch.nn.ModuleList(torch.nn.Linear(a, b) for a, b in pairwise(sizes))
        self.near = torch.nn.ModuleList(torch.nn.Linear(a, b) for a, b in pairwise(sizes))
        self.out = torch.nn.Linear(width, 3)

    def mean(self, x):
        """Mean over the neighbours of each node."""
        return torch.zeros_like(x).index_add(0, self.to, x[self.of]) / self.count

    def forward(self, contact):
        x = torch.cat([contact, self.place], dim=1)
        for own, near in zip(self.own, self.near, strict=True):
            x = torch.relu(own(x) + near(self.mean(x)))
        return self.out(x)

    def predict(self, nodes, displacements):
        """What `evaluate` calls."""
        contact = torch.zeros_like(self.place).index_add(0, torch.tensor(nodes), torch.tensor(displacements))
        with torch.no_grad():
            return self(contact).numpy()


torch.set_num_threads(1)  # so small a network gains nothing from more
torch.manual_seed(0)
network = Averaging(mesh)
fields = [tuple(map(torch.from_numpy, (table.contact_field(i), table.displacement[i]))) for i in range(len(table))]
optimizer = torch.optim.Adam(network.parameters(), lr=1e-2)
losses = np.zeros(40)
for epoch in range(len(losses)):
    for contact, truth in fields:
        optimizer.zero_grad()
        loss = (network(contact) - truth).norm(dim=1).mean()
        loss.backward()
        optimizer.step()
        losses[epoch] += float(loss.detach()) / len(fields)

figure, axes = plt.subplots(figsize=(5.0, 3.2), layout="constrained")
axes.plot(losses)
axes.set(xlabel="epoch", ylabel="mean error [mm]", ylim=(0.0, None))

# %%
# **Check.** Predicting no motion at all has, by definition, the mean displacement as its error; a network that has
# learned anything lies below. (These are its training samples: this shows that it runs, not that it is good.)

nothing = evaluate(ZeroModel(mesh.n_points), table, mesh, split="train").metrics
learned = evaluate(network, table, mesh, split="train").metrics
print(f"no motion {nothing['mee'].mean():.3f} mm, {network.name} {learned['mee'].mean():.3f} mm")
assert np.allclose(nothing["mee"], nothing["mean_displacement"], rtol=1e-5)
assert learned["mee"].mean() < 0.7 * nothing["mee"].mean()

# %%
# **Check.** Numbering is no feature of a body: the same network on the renumbered mesh gives the renumbered answer.

order = np.random.default_rng(0).permutation(mesh.n_points)
renumbered = replace(
    mesh, points=mesh.points[order], cells=np.argsort(order)[mesh.cells].astype(np.int32), part=mesh.part[order],
    fixed=mesh.fixed[order],
)
twin = Averaging(renumbered)
twin.load_state_dict(network.state_dict())
nodes, moved = table.contact(0)
assert np.abs(twin.predict(np.argsort(order)[nodes], moved) - network.predict(nodes, moved)[order]).max() < 1e-4
