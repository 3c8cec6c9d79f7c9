"""Live sessions as a client sees them: fields a second, delays, pictures of the page, memory of the server.

``python -m benchmarks.live BUNDLE`` starts ``mixpinn serve`` on two cores and drags the probe over the whole back for
ten minutes (``--seconds``): lanes along z, the depth going up and down between 4 and 16 mm, turning slowly. Poses go
out at ``--rate`` a second whatever comes back. Every frame that comes names its pose; one that is older than one
before it, or whose pose is not the one that was sent under its number, is counted as stale. Afterwards Chromium drags
the probe over the page (``--page-seconds``), and many poses are answered at once in this process.

The last line is a JSON object: ``fields_per_s`` that arrived; ``delay_ms_p50`` and ``delay_ms_p95`` from sending a pose
to having its field; ``server_growth_mb`` of the server's memory from ten seconds after the start to the end;
``pictures_per_s`` and ``drag_to_picture_ms_p95`` from a probe that was moved on the page to the picture that shows its
answer, ``external_requests`` beyond the server (null without Chromium or Playwright); ``poses_per_s`` of `press_many`.
``stale``, ``refused``, ``not_converged``, ``behind_s`` (the client was late with its poses), ``server_cpu_ms``
(processor time of the server for each field), ``cores`` and ``load`` say how it went.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
from websockets.sync.client import connect

from benchmarks.history import report
from benchmarks.live_page import drag_on_page
from benchmarks.machine import processor_seconds
from mixpinn.geometry.probe_pose import ProbePose
from mixpinn.server.protocol import SUBPROTOCOL, Flag, decode_answer
from mixpinn.serving import HybridPredictor, load_predictor
from mixpinn.serving.live import SkinPlacement

_LANE, _SPEED = 12.0, 40.0
"""Distance of the lanes [mm] and speed of the drag [mm/s]."""
_SETTLED = 10.0
"""Memory counts from here on [s]."""


def drag(predictor: HybridPredictor, seconds: float, rate: float) -> list[ProbePose]:
    """Poses of a drag over the whole back, one after another: up and down in lanes, and again."""
    domain, skin = predictor.pressing.domain, SkinPlacement(predictor.pressing)
    low, high = np.array(domain.low), np.array(domain.high)
    lanes = np.linspace(low[0], high[0], max(2, round((high[0] - low[0]) / _LANE)))
    length = high[1] - low[1]
    corners = [(x, low[1] + length * ((k + side) % 2)) for k, x in enumerate(lanes) for side in (0, 1)]
    way = np.array(corners + corners[::-1])
    reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    times = np.arange(int(seconds * rate)) / rate
    at = (times * _SPEED) % reached[-1]
    x, z = (np.interp(at, reached, way[:, axis]) for axis in (0, 1))
    depth = 10.0 + 6.0 * np.sin(2.0 * np.pi * times / 7.0)
    turn = 45.0 + 45.0 * np.sin(2.0 * np.pi * times / 31.0)
    above = float(predictor.mesh.points[:, 1].max())
    return [
        skin.place((px, above, pz), depth=float(d), turn_deg=float(t))
        for px, pz, d, t in zip(x, z, depth, turn, strict=True)
    ]


class Server:
    """``mixpinn serve`` in a process of its own."""

    def __init__(self, bundle: Path) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-u", "-m", "mixpinn.cli", "serve", str(bundle), "--port", "0"], stdout=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        found = re.search(r"http://\S+", line)
        if found is None:
            raise SystemExit(f"no server: {line!r}")
        self.url = found.group().rstrip("/")

    @property
    def memory_mb(self) -> float:
        """Resident memory of the process [MB]."""
        text = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(r"VmRSS:\s+(\d+)", text).group(1)) / 1024.0  # type: ignore[union-attr]

    @property
    def cpu_seconds(self) -> float:
        """Processor time of the process so far [s]."""
        return processor_seconds(self.process.pid)

    def stop(self) -> None:
        """End it."""
        self.process.terminate()
        self.process.wait(20.0)


def stream(server: Server, poses: list[ProbePose], rate: float) -> dict[str, Any]:
    """Send the poses at their times, and take what comes."""
    address = server.url.replace("http", "ws") + "/live"
    sent = np.full(len(poses), np.nan)
    delays: list[float] = []
    wrong = {"stale": 0, "refused": 0, "not_converged": 0}
    messages = [json.dumps({
        "type": "pose", "id": k, "tip": pose.translation.tolist(), "rotation": pose.rotation.ravel().tolist(),
    }) for k, pose in enumerate(poses)]
    memory: list[float] = []
    with connect(address, subprotocols=[SUBPROTOCOL], compression=None, max_size=None, proxy=None) as socket:
        socket.send(json.dumps({"type": "hello", "version": 1, "vertices": "nodes", "encoding": "int16"}))
        socket.recv(10.0)
        done = threading.Event()

        def receive() -> None:
            newest = -1
            while not done.is_set():
                try:
                    data = socket.recv(0.2)
                except TimeoutError:
                    continue
                now = time.perf_counter()
                if isinstance(data, str):
                    wrong["refused"] += json.loads(data).get("type") == "error"
                    continue
                delays.append(1e3 * (now - sent[(frame := decode_answer(data)).pose_id]))
                matrix = frame.probes[0]["matrix"]
                here = np.abs(matrix[:3, 3] - poses[frame.pose_id].translation).max() < 1e-3
                wrong["stale"] += frame.pose_id <= newest or not here or len(frame.displacement) == 0
                wrong["not_converged"] += Flag.CONVERGED not in frame.flags
                newest = max(newest, frame.pose_id)

        thread = threading.Thread(target=receive)
        thread.start()
        began, worked = time.perf_counter(), server.cpu_seconds
        for k, message in enumerate(messages):
            ahead = began + k / rate - time.perf_counter()
            if ahead > 0.0:
                time.sleep(ahead)
            sent[k] = time.perf_counter()
            socket.send(message)
            if k % max(1, round(rate)) == 0 and k / rate >= min(_SETTLED, 0.2 * len(poses) / rate):
                memory.append(server.memory_mb)
        elapsed = time.perf_counter() - began
        behind, worked = elapsed - len(messages) / rate, server.cpu_seconds - worked
        time.sleep(0.5)
        done.set()
        thread.join()
    return {
        "fields_per_s": len(delays) / elapsed, "delay_ms_p50": float(np.percentile(delays, 50)),
        "delay_ms_p95": float(np.percentile(delays, 95)), "server_growth_mb": max(memory) - memory[0],
        "behind_s": behind, "server_cpu_ms": 1e3 * worked / max(len(delays), 1), **wrong,
    }


def many(predictor: HybridPredictor, poses: list[ProbePose], repeats: int = 3) -> float:
    """Poses a second of `press_many`; the best of some runs on 200 poses."""
    chosen = [poses[k] for k in np.random.default_rng(0).integers(len(poses), size=200)]
    tips = np.array([pose.translation for pose in chosen])
    turns = np.array([pose.rotation for pose in chosen])
    seconds = []
    for _ in range(repeats):
        began = time.perf_counter()
        predictor.press_many(tips, rotations=turns)
        seconds.append(time.perf_counter() - began)
    return len(tips) / min(seconds)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bundle", type=Path)
    parser.add_argument("--seconds", type=float, default=600.0, help="of the drag")
    parser.add_argument("--rate", type=float, default=72.0, help="poses a second that are sent")
    parser.add_argument("--page-seconds", type=float, default=20.0, help="of the drag on the page; 0 leaves it out")
    parser.add_argument("--cores", type=int, default=2, help="that server and client may use")
    args = parser.parse_args()
    cores = sorted(os.sched_getaffinity(0))[: args.cores]
    os.sched_setaffinity(0, cores)
    predictor = load_predictor(args.bundle)
    if not isinstance(predictor, HybridPredictor):
        raise SystemExit("a hybrid bundle is needed")
    poses = drag(predictor, args.seconds, args.rate)
    server = Server(args.bundle)
    try:
        figures = stream(server, poses, args.rate)
        print(json.dumps(figures), flush=True)
        figures |= drag_on_page(server.url, args.page_seconds)
    finally:
        server.stop()
    report("live", {
        **figures, "poses_per_s": many(predictor, poses), "seconds": args.seconds, "rate": args.rate,
        "cores": len(cores), "load": os.getloadavg()[0],
    })


if __name__ == "__main__":
    main()
