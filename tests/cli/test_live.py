"""`view` as a user starts it: an address to open, and the page behind it."""

import signal
import subprocess
import sys
import urllib.request
from dataclasses import replace

import pytest

from children import hear_interrupts
from mixpinn.press.files import save_pose_model
from mixpinn.reduced.hybrid import MESH_FILE
from serving.live.pressed import block_predictor


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bundle")
    predictor = block_predictor()
    predictor.mesh.save(folder / MESH_FILE)
    model = replace(predictor.model, name="block")
    model.save(folder)
    save_pose_model(replace(predictor.pose, hybrid=model), folder)
    return folder


def test_view_serves_the_page_until_it_is_interrupted(bundle) -> None:
    command = [sys.executable, "-m", "mixpinn.cli", "view", str(bundle), "--port", "0", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, preexec_fn=hear_interrupts) as running:
        line = running.stdout.readline()
        address = next(word for word in line.split() if word.startswith("http://127.0.0.1:"))
        with urllib.request.urlopen(address) as page:
            assert b"<title>MIXPINN</title>" in page.read()
        with urllib.request.urlopen(f"{address}main.js") as script:
            assert script.headers["content-type"].startswith("text/javascript")
        running.send_signal(signal.SIGINT)
    assert running.returncode == 0  # being told to end is how a server ends

