"""Kills of a command and of its workers, and what must hold afterwards."""

import csv
import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.numpy import load_file

from children import hear_interrupts
from mixpinn.dataset import SimulationStore

SAID = "stopped; the same command goes on from here"
_VOLATILE = re.compile(
    r"second|minute|after_labels|started|finished|command|version|time|_ms$|peak_mb|\[ms\]|\[MB\]|input_paths|attempts"
    r"|platform|^sha256$|^inputs$|^headline$|^weights$"
)
"""What differs between two runs by nature. Hashes of weights are among it: the weights themselves are compared."""
_BYTES = {".vtu", ".npy", ".gz", ".stl", ".py"}


@dataclass(frozen=True)
class Verb:
    """A command.

    Attributes:
        name: of the drill.
        words: the command without ``--out``.
        out: what its output is called; None where it writes nothing.
        workers: whether it has child processes.
    """

    name: str
    words: tuple[str, ...]
    out: str | None = "out"
    workers: bool = False

    def command(self, folder: Path) -> list[str]:
        """The whole command line into `folder`."""
        out = [] if self.out is None else ["--out", str(folder / self.out)]
        return [sys.executable, "-m", "mixpinn.cli", *self.words, *out]


@dataclass(frozen=True)
class Pace:
    """How fast this machine is at the moment.

    Attributes:
        seconds: from start to end of one small command that is left alone [s].
    """

    seconds: float

    @property
    def timeout(self) -> float:
        """Setting of the time-outs [s]: a worker that is stopped is found out after so long, a slow one is not."""
        return max(10.0, 8.0 * self.seconds)

    def patience(self, alone: float) -> float:
        """After which a command hangs [s] that takes `alone` [s] when it is left alone and may wait for time-outs."""
        return 12.0 * self.timeout + 20.0 * alone


def start(verb: Verb, folder: Path) -> subprocess.Popen[bytes]:
    """The command in a session of its own, with temporary files of its own."""
    (folder / "tmp").mkdir(parents=True, exist_ok=True)
    return subprocess.Popen(
        verb.command(folder), start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        preexec_fn=hear_interrupts,
        env={**os.environ, "TMPDIR": str(folder / "tmp")},
    )


def finish(process: subprocess.Popen[bytes], patience: float) -> tuple[int, str, str]:
    """Exit code, standard output and standard error; a process that hangs fails the drill."""
    try:
        out, err = process.communicate(timeout=patience)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        raise AssertionError(f"still running after {patience:.0f} s: {process.args}") from None
    return process.returncode, out.decode(errors="replace"), err.decode(errors="replace")


def whole(verb: Verb, folder: Path, patience: float = 1800.0) -> tuple[float, str]:
    """Run to the end; how long that took [s], and what was said on standard output."""
    began = time.monotonic()
    code, out, err = finish(start(verb, folder), patience)
    assert code == 0, err
    return time.monotonic() - began, out


def kill(process: subprocess.Popen[bytes], number: int) -> None:
    """Send a signal to a command and all its processes."""
    if process.poll() is None:
        os.killpg(process.pid, number)


def stop_a_worker(process: subprocess.Popen[bytes], rng: np.random.Generator) -> bool:
    """Stop one of the command's workers, if it has any at the moment."""
    found = [number for number in session(process.pid) if number != process.pid and "tracker" not in command_of(number)]
    if found and process.poll() is None:
        try:
            os.kill(int(rng.choice(found)), signal.SIGSTOP)
        except ProcessLookupError:
            return False
    return bool(found)


def session(leader: int) -> list[int]:
    """Processes of the session of `leader` that have not ended."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            fields = (path / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == leader and fields[0] != "Z":
            found.append(int(path.name))
    return found


def command_of(number: int) -> str:
    """Command line of a process."""
    try:
        return Path(f"/proc/{number}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
    except OSError:
        return ""


def listens(process: subprocess.Popen[bytes]) -> bool:
    """Whether the command deals with signals by now; Python itself answers before with its own traceback."""
    try:
        status = Path(f"/proc/{process.pid}/status").read_text()
    except OSError:
        return False
    caught = int(re.search(r"SigCgt:\s*([0-9a-f]+)", status)[1], 16)
    return bool(caught >> (signal.SIGTERM - 1) & 1)


def left_behind(folder: Path) -> list[str]:
    """Temporary files and locks below `folder`."""
    return sorted(
        path.relative_to(folder).as_posix() for path in folder.rglob("*")
        if path.name.startswith((".writing-", "mixpinn-scratch-", "pymp-")) or path.name == ".lock"
    )


def differences(first: Path, second: Path) -> list[str]:
    """What differs in the results of two runs, apart from times, paths and what libraries log."""
    if first.is_file():
        return [] if first.read_bytes() == second.read_bytes() else [first.name]
    names = [_names(folder) for folder in (first, second)]
    found = [f"only in one: {name}" for name in sorted(names[0] ^ names[1])]
    for name in sorted(names[0] & names[1]):
        if not _same(first, second, name):
            found.append(name)
    for record in first.rglob("store.json"):
        found += _differing_poses(record.parent, second / record.parent.relative_to(first))
    return found


def _names(folder: Path) -> set[str]:
    return {
        path.relative_to(folder).as_posix() for path in folder.rglob("*")
        if path.is_file() and "tfevents" not in path.name and not _in_a_pose(path)
    }


def _in_a_pose(path: Path) -> bool:
    return any(part.startswith("pose_") for part in path.parts) and path.suffix != ".npz"


def _same(first: Path, second: Path, name: str) -> bool:
    if name.endswith(".npz"):
        one, other = (dict(np.load(folder / name)) for folder in (first, second))
        return one.keys() == other.keys() and all(np.array_equal(array, other[key]) for key, array in one.items())
    if not name.endswith(".safetensors"):
        return bool(_content(first, name) == _content(second, name))
    one, other = load_file(first / name), load_file(second / name)
    # Sums of the linear algebra depend on where arrays lie in memory, in the last digits.
    return one.keys() == other.keys() and all(
        array.shape == other[key].shape
        and np.allclose(array, other[key], rtol=0.0, atol=1e-9 * _largest(array), equal_nan=True)
        for key, array in one.items()
    )


def _largest(array: Any) -> float:
    return float(np.abs(array[np.isfinite(array)]).max(initial=0.0))


def _content(root: Path, name: str) -> Any:
    path = root / name
    if path.name == "stage_seconds.json":
        return None
    if path.suffix == ".json" and path.name not in ("manifest.json",) and not path.name.endswith(".manifest.json"):
        return _plain(json.loads(path.read_text().replace(str(root), "OUT")))
    if path.suffix in _BYTES:
        return path.read_bytes()
    if path.suffix == ".csv":
        return [
            {key: value for key, value in row.items() if not _VOLATILE.search(key or "")}
            for row in csv.DictReader(io.StringIO(path.read_text()))
        ]
    return None


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        if {"columns", "rows"} <= value.keys():  # a table
            value = {**value, "rows": [
                {name: cell for name, cell in zip(value["columns"], row, strict=True)
                 if not _VOLATILE.search(name.lower())} for row in value["rows"]
            ]}
        return {key: _plain(entry) for key, entry in value.items() if not _VOLATILE.search(key)}
    return [_plain(entry) for entry in value] if isinstance(value, list) else value


def _differing_poses(first: Path, second: Path) -> list[str]:
    found = []
    one, other = SimulationStore.open(first), SimulationStore.open(second)
    for pose in one.poses:
        states = one.status(pose).state, other.status(pose).state
        if states[0] != states[1]:
            found.append(f"{pose.name}: {states[0]} and {states[1]}")
        elif str(states[0]) == "done":
            arrays, others = one.load(pose).arrays(), other.load(pose).arrays()
            found += [
                f"{pose.name}: {name}" for name in arrays.keys() - {"seconds"}
                if not np.array_equal(arrays[name], others[name], equal_nan=arrays[name].dtype.kind == "f")
            ]
    return found


def two_at_once(verb: Verb, reference: Path, folder: Path, *, patience: float) -> list[str]:
    """Start a command twice at the same moment into one folder, run it once more, and say what is wrong."""
    ends = [finish(process, patience) for process in [start(verb, folder) for _ in range(2)]]
    wrong = [f"traceback: {err[-2000:]}" for _, _, err in ends if "Traceback" in err]
    if sorted(code for code, _, _ in ends) not in ([0, 0], [0, 2]):
        wrong.append(f"exit codes and last words: {[(code, err[-300:]) for code, _, err in ends]}")
    wrong += [
        f"refused for another reason: {err[-300:]}" for code, _, err in ends if code == 2 and "at work in it" not in err
    ]
    return wrong + _after(verb, reference, folder, patience)


def killed(
    verb: Verb, reference: Path, folder: Path, *, kinds: Sequence[str], seconds: float, pace: Pace,
    rng: np.random.Generator,
) -> list[str]:
    """Kill a command at random moments, one kill of each of `kinds`, run it to the end, and say what is wrong.

    Args:
        verb: the command.
        reference: folder of a run that was left alone.
        folder: where this one goes.
        kinds: names of signals for all its processes, or ``worker`` to stop one of its workers.
        seconds: how long it takes when it is left alone.
        pace: of the machine.
        rng: of the moments.
    """
    wrong, patience = [], pace.patience(seconds)
    for kind in kinds:
        process = start(verb, folder)
        while not listens(process) and process.poll() is None:
            time.sleep(0.01)
        time.sleep(rng.uniform(0.0, max(0.2, seconds - 0.5)))
        began, ended = time.monotonic(), process.poll() is not None
        if kind == "worker":
            if not stop_a_worker(process, rng):
                kill(process, signal.SIGKILL)
        else:
            kill(process, getattr(signal, kind))
        code, _, err = finish(process, patience)
        took = time.monotonic() - began
        if "Traceback" in err:
            wrong.append(f"{kind}: traceback: {err[-2000:]}")
        if kind in ("SIGINT", "SIGTERM") and not ended and code not in (0, 128 + getattr(signal, kind)):
            wrong.append(f"{kind}: exit code {code} after {took:.1f} s: {err[-300:]}")
        if kind in ("SIGINT", "SIGTERM") and code > 128 and not err.rstrip().endswith(SAID):
            wrong.append(f"{kind}: last line {err.splitlines()[-1:]}")
        deadline = time.monotonic() + pace.timeout
        while session(process.pid) and time.monotonic() < deadline:
            time.sleep(0.05)
        if alive := session(process.pid):
            wrong.append(f"{kind}: left running: {[command_of(number) for number in alive]}")
            for number in alive:
                os.kill(number, signal.SIGKILL)
    return wrong + _after(verb, reference, folder, patience)


def _after(verb: Verb, reference: Path, folder: Path, patience: float) -> list[str]:
    """Run to the end, and say what is wrong then."""
    code, out, err = finish(start(verb, folder), patience)
    if code != 0:
        return [f"the rerun failed: {err[-2000:]}"]
    if verb.out is None:
        return [] if out == (reference / "said.txt").read_text() else ["it says something else"]
    wrong = [f"left behind: {name}" for name in left_behind(folder)]
    return wrong + [f"differs: {name}" for name in differences(reference / verb.out, folder / verb.out)]
