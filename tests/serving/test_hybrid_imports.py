"""A hybrid bundle is loaded and answers in a process that has neither torch nor the solver."""

import json
import os
import subprocess
import sys

from mixpinn.fem import PAPER_TISSUE, ContactConfig, SuperLUSolver
from mixpinn.geometry.probe_shapes import spherical_probe
from mixpinn.press.files import save_pose_model
from mixpinn.records import MESH_FILE
from mixpinn.reduced.build_prior import build_prior
from mixpinn.reduced.equilibrium import Equilibrium
from mixpinn.reduced.hybrid import HybridModel
from mixpinn.stages.hybrid import plain_pose_model
from reduced.pressed_block import top_nodes

SCRIPT = """
import json, sys
from mixpinn.serving import load_predictor
predictor = load_predictor(sys.argv[1])
nodes = json.loads(sys.argv[2])
held = predictor.predict_at(nodes, [[0.0, -1.0, 0.0]] * len(nodes))
pressed = predictor.press([[18.0, 39.0, 22.0]])
print(json.dumps([float(abs(held.displacement).max()), float(abs(pressed.displacement).max()), sorted(sys.modules)]))
"""


def test_a_bundle_answers_without_torch_and_solver(mesh, tmp_path):
    prior = build_prior(mesh, [PAPER_TISSUE], nodes=top_nodes(mesh), linear=SuperLUSolver())
    model = HybridModel.of_prior(prior, Equilibrium.of_materials(mesh, [PAPER_TISSUE]))
    mesh.save(tmp_path / MESH_FILE)
    model.save(tmp_path)
    save_pose_model(plain_pose_model(model, spherical_probe(radius=12.0, subdivisions=2), ContactConfig()), tmp_path)
    nodes = [int(node) for node in prior.nodes[:3]]
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(tmp_path), json.dumps(nodes)], capture_output=True, text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"}, timeout=300,
    )
    assert done.returncode == 0, done.stderr
    held, pressed, loaded = json.loads(done.stdout.strip().splitlines()[-1])
    assert held > 0.9
    assert pressed > 0.1
    absent = ("torch", "lightning", "pypardiso", "mixpinn.fem", "mixpinn.networks", "mixpinn.training", "mixpinn.graph")
    assert not [name for name in loaded if name in absent or name.startswith(tuple(f"{top}." for top in absent))]
