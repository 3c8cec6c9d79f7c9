"""Kills of a server that somebody is connected to, and what must hold afterwards: it ends, and the next one serves."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from children import PATIENCE, hear_interrupts
from drill.kill_drill import command_of, listens, session
from pipeline.chain import contents

GRACE = 30.0
"""How long a server may take to end [s]; it waits two seconds for requests that are being answered."""


@dataclass(frozen=True)
class Service:
    """A command that serves until it is stopped.

    Attributes:
        name: of the verb.
        words: the command without the port.
        request: what a client sends first.
        clean: whether it ends with exit code 0 when it is told to; else with 128 and the signal, as all do while they
            start.
    """

    name: str
    words: tuple[str, ...]
    request: bytes
    clean: bool


@dataclass(frozen=True)
class Server:
    """A service that was started, and the port it was told to use."""

    process: "subprocess.Popen[bytes]"
    port: int

    def wait(self) -> None:
        """Until it listens."""
        deadline = time.monotonic() + PATIENCE
        while True:
            with suppress(OSError), socket.create_connection(("127.0.0.1", self.port), timeout=5.0):
                return
            assert self.process.poll() is None, self.process.communicate()
            assert time.monotonic() < deadline
            time.sleep(0.05)

    def answers(self, request: bytes) -> socket.socket:
        """A connection on which the server has said something."""
        client = socket.create_connection(("127.0.0.1", self.port), timeout=60.0)
        client.sendall(request)
        assert client.recv(1)
        return client


def start(service: Service, folder: Path, port: int) -> Server:
    """Start it in a session of its own, with temporary files of its own."""
    (folder / "tmp").mkdir(parents=True, exist_ok=True)
    process = subprocess.Popen(
        [sys.executable, "-m", "mixpinn.cli", *service.words, "--port", str(port)], start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, preexec_fn=hear_interrupts,
        env={**os.environ, "TMPDIR": str(folder / "tmp")},
    )
    return Server(process, port)


def free_port() -> int:
    """A port that nobody listens at."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def killed(service: Service, bundle: Path, folder: Path, *, kind: str, rng: np.random.Generator) -> list[str]:
    """Send a server a signal while it starts and while it serves, start it once more, and say what is wrong.

    Args:
        service: the command.
        bundle: what it serves, which must stay as it is.
        folder: for temporary files.
        kind: name of the signal; after SIGSTOP it goes on, and must answer again.
        rng: of the moment while it starts.
    """
    port, before, wrong = free_port(), contents(bundle), []
    for moment in ("starting", "serving"):
        server = start(service, folder, port)
        client = None
        if moment == "serving":
            server.wait()
            client = server.answers(service.request)
        else:
            while not listens(server.process) and server.process.poll() is None:
                time.sleep(0.01)
            time.sleep(rng.uniform(0.0, 3.0))
        where = f"{kind} while {moment}"
        if kind == "SIGSTOP":
            os.killpg(server.process.pid, signal.SIGSTOP)
            time.sleep(2.0)
            os.killpg(server.process.pid, signal.SIGCONT)
            server.wait()
            server.answers(service.request).close()
            wrong += _end(service, server, "SIGTERM", where)
        else:
            wrong += _end(service, server, kind, where)
        if client is not None:
            client.close()
    server = start(service, folder, port)  # on the same port, which is free again
    server.wait()
    server.answers(service.request).close()
    wrong += _end(service, server, "SIGTERM", f"{kind}: the rerun")
    if contents(bundle) != before:
        wrong.append(f"{kind}: the bundle is another one")
    return wrong + [f"{kind}: left behind: {path}" for path in (folder / "tmp").iterdir()]


def _end(service: Service, server: Server, kind: str, where: str) -> list[str]:
    """Send the signal, and say what is wrong with how the server ends."""
    number, wrong = getattr(signal, kind), []
    began = time.monotonic()
    os.killpg(server.process.pid, number)
    try:
        out, err = server.process.communicate(timeout=GRACE)
    except subprocess.TimeoutExpired:
        os.killpg(server.process.pid, signal.SIGKILL)
        server.process.communicate()
        return [f"{where}: still running after {GRACE:g} s"]
    said, took = (out + err).decode(errors="replace"), time.monotonic() - began
    if "Traceback" in said:
        wrong.append(f"{where}: traceback: {said[-2000:]}")
    if kind != "SIGKILL":
        codes = {0} if service.clean else {128 + number}
        if "starting" in where:
            codes.add(128 + number)
        last = err.decode(errors="replace").rstrip().rpartition("\n")[2]
        if server.process.returncode not in codes:
            wrong.append(f"{where}: exit code {server.process.returncode} after {took:.1f} s: {said[-300:]}")
        if not last.startswith("mixpinn: stopped") or re.search(r"\n.*mixpinn: ", said.rstrip()[:-len(last)]):
            wrong.append(f"{where}: its last words: {said[-300:]}")
    deadline = time.monotonic() + 10.0
    while session(server.process.pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    return wrong + [f"{where}: left running: {command_of(number)}" for number in session(server.process.pid)]
