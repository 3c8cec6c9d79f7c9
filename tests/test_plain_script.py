"""The typical jobs in a plain script, without a guard of its main part: worker processes do not begin it anew."""

import subprocess
import sys

SCRIPT = """
from dataclasses import replace
from pathlib import Path

import mixpinn as mx
from mixpinn.anatomy import tiny_phantom

with open("begun.txt", "a") as file:
    file.write("once more\\n")
mesh = mx.make_mesh(tiny_phantom(), size=8.0)
scene = mx.Scene(mesh)
protocol = replace(mx.protocols.SMALL, max_positions=2, steps=1)
store = mx.simulate(scene, protocol, out="simulation", workers=1)
print([str(status.state) for status in store.statuses()])
"""


def test_simulations_in_a_plain_script(tmp_path):
    (tmp_path / "script.py").write_text(SCRIPT)
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, timeout=600, check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip().endswith("['done', 'done']"), done.stdout
    assert (tmp_path / "begun.txt").read_text().count("once more") == 1
