"""How long after a pose the rigid parts' transforms arrive over OpenIGTLink.

``python -m benchmarks.stream BUNDLE`` starts ``mixpinn stream`` as a process of its own, drags a probe over the back at
30 poses a second for five minutes, and prints as its last line a JSON object: ``delay_ms_*`` from the moment at which a
pose is sent to that at which the transform of the last rigid part of this pose or of a newer one was received;
``poses``, of which ``passed_over`` were replaced by a newer one before their turn; ``transforms_per_s`` received;
``processor_ms_per_answer``, what the stream's process computes for an answer, skins included, however busy the machine
is; ``refused``, poses that were answered by a status instead; ``cores`` and ``load`` of the machine at the end. Skins
are sent ten times a second meanwhile, as by default.
"""

import argparse
import asyncio
import json
import os
import re
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.history import report
from benchmarks.machine import processor_seconds
from mixpinn.base.errors import InputError
from mixpinn.server.igtl.header import HEADER_SIZE, Header
from mixpinn.server.igtl.message import Message
from mixpinn.server.igtl.ras import RasFrame
from mixpinn.server.igtl.transform import TransformBody

_parser = argparse.ArgumentParser(prog="python -m benchmarks.stream", description=__doc__)
_parser.add_argument("bundle", type=Path)
_parser.add_argument("--seconds", type=float, default=300.0)
_parser.add_argument("--rate", type=float, default=30.0, help="poses a second")
_parser.add_argument("--option", action="append", default=[], help="of mixpinn stream, for example --grid-rate=2")
_WARM_UP = 30
_STEPS = 400


def drag(bundle: Path) -> tuple[list[bytes], tuple[str, ...]]:
    """Content of the poses of a drag over the back and back again, and the names of the rigid parts.

    The tip moves along a closed curve over the skin of the rigid parts, 3 to 12 mm deep.
    """
    from mixpinn.serving import HybridPredictor
    from mixpinn.serving.live import SkinPlacement

    predictor = HybridPredictor.load(bundle, warm_up=False)
    placement, mesh = SkinPlacement(predictor.pressing), predictor.mesh
    frame, bones = RasFrame.of_mesh(mesh), mesh.points[mesh.part > 0]
    centre = 0.5 * (bones.min(axis=0) + bones.max(axis=0))
    reach = 0.4 * (bones.max(axis=0) - bones.min(axis=0))
    contents = []
    for step in range(_STEPS):
        turn = 2.0 * np.pi * step / _STEPS
        point = centre + reach * [np.sin(3.0 * turn), 0.0, np.sin(2.0 * turn)]
        try:
            pose = placement.place(point, depth=7.5 + 4.5 * np.sin(11.0 * turn), turn_deg=20.0 * np.sin(turn))
        except InputError:
            continue
        contents.append(TransformBody(frame.probe_from_world(pose.rotation, pose.translation)).pack())
    return contents, mesh.rigid_names


async def play(options: argparse.Namespace, contents: Sequence[bytes], parts: int) -> dict[str, Any]:
    """Figures of one drag."""
    words = [str(options.bundle), "--port", "0", *(word for pair in options.option for word in pair.split("="))]
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "mixpinn.cli", "stream", *words, stdout=asyncio.subprocess.PIPE,
    )
    assert process.stdout is not None
    try:
        port = None
        while port is None:
            line = (await process.stdout.readline()).decode()
            assert line, "the stream ended before it listened"
            found = re.search(r"listening at .*:(\d+)", line)
            port = int(found[1]) if found else None
        return await _talk(port, process.pid, options, contents, parts)
    finally:
        process.terminate()
        await process.wait()


async def _talk(
    port: int, pid: int, options: argparse.Namespace, contents: Sequence[bytes], parts: int,
) -> dict[str, Any]:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    sent: list[float] = []
    arrived: dict[int, list[float]] = {}
    refused = 0

    async def listen() -> None:
        nonlocal refused
        while True:
            header = Header.unpack(await reader.readexactly(HEADER_SIZE))
            body = await reader.readexactly(header.body_size)
            if header.type == "TRANSFORM" and header.timestamp:
                Message.unpack(header, body)
                arrived.setdefault(header.timestamp, []).append(time.perf_counter())
            elif header.type == "STATUS" and header.timestamp < 1 << 32:
                refused += 1

    listening = asyncio.create_task(listen())
    count, taken, answered = int(options.seconds * options.rate) + _WARM_UP, 0.0, 0
    began = time.perf_counter()
    for number in range(count):
        content = contents[number % len(contents)]
        if number == _WARM_UP:
            taken, answered = processor_seconds(pid), len(arrived)
        sent.append(time.perf_counter())
        writer.write(Message("TRANSFORM", "Probe", content, number + 1).pack())
        await asyncio.sleep(max(0.0, began + (number + 1) / options.rate - time.perf_counter()))
    await asyncio.sleep(1.0)
    listening.cancel()
    writer.close()
    taken = (processor_seconds(pid) - taken) / max(len(arrived) - answered, 1)
    complete = {number: times[parts - 1] for number, times in arrived.items() if len(times) >= parts}
    delays, newest = [], np.inf
    for number in range(count, _WARM_UP, -1):
        newest = min(newest, complete.get(number, np.inf))
        delays.append(1e3 * (newest - sent[number - 1]))
    at = dict(zip(("p50", "p95", "p99", "max"), np.percentile(delays, [50, 95, 99, 100]), strict=True))
    return {
        **{f"delay_ms_{name}": round(float(value), 2) for name, value in at.items()}, "poses": len(delays),
        "passed_over": sum(number not in complete for number in range(_WARM_UP + 1, count + 1)),
        "processor_ms_per_answer": round(1e3 * taken, 2),
        "transforms_per_s": round(sum(map(len, arrived.values())) / (sent[-1] - sent[0]), 1), "refused": refused,
        "rigid_parts": parts, "seconds": options.seconds, "cores": os.cpu_count(), "load": round(os.getloadavg()[0], 2),
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Run it."""
    options = _parser.parse_args(arguments)
    contents, names = drag(options.bundle)
    print(f"{len(contents)} poses along the way, {len(names)} rigid parts", flush=True)
    figures = asyncio.run(play(options, contents, len(names)))
    print(json.dumps(figures, indent=1))
    report("stream", figures)


if __name__ == "__main__":
    main()
