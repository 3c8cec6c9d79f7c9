"""Reading foreign files in a process of its own, whose crash, hang or hunger costs one file and not this process.

Libraries in C++ believe what a file says about itself: a damaged one can end the process that reads it, or ask for more
memory than there is. `read_apart` has a child do it, under a limit of memory and of processor time, and takes over
plain arrays. The child is started when it is first needed, stays for further files, and ends with its parent.
"""

import atexit
import contextlib
import importlib
import json
import math
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mixpinn.base.arrays import AnyArray
from mixpinn.base.bounded import memory_at_hand
from mixpinn.base.scratch_folder import scratch_folder
from mixpinn.base.tensor_file import read_arrays, write_arrays

Reader = Callable[[Path], tuple[Mapping[str, AnyArray], object]]
"""What the child runs: arrays of numbers by name, and plain values that go with them."""

_MEMORY, _MEMORY_A_BYTE = 1 << 30, 64
"""Memory of a read [byte]: so much, and so many times the size of the file."""
_SECONDS, _SECONDS_A_BYTE = 10.0, 1e-6
"""Processor time of a read [s]: so much, and so much for each byte of the file."""
_WAIT = 20.0
"""Times the processor time that the parent waits: on a busy machine the child gets little of it."""
_child: dict[int, "subprocess.Popen[bytes]"] = {}
"""The child of this process, by the process number; one that was forked does not share it."""
_one_at_a_time = threading.Lock()
_ROOT = Path(__file__).parents[2]


def read_apart(reader: Reader, path: Path | str) -> tuple[dict[str, AnyArray], Any]:
    """Have the child run `reader`, a function of a module, on `path`.

    Raises:
        ValueError: the reader raised an exception, crashed, or went beyond its memory or time.
    """
    path = Path(path).absolute()
    size = path.stat().st_size
    seconds = _SECONDS + _SECONDS_A_BYTE * size
    with _one_at_a_time, scratch_folder() as folder:
        out = folder / "arrays.safetensors"
        answer = _ask({
            "module": reader.__module__, "function": reader.__name__, "path": str(path), "out": str(out),
            "memory": min(_MEMORY + _MEMORY_A_BYTE * size, memory_at_hand()), "seconds": seconds,
        }, wait=30.0 + _WAIT * seconds)
        if "error" in answer:
            raise ValueError(str(answer["error"]))
        return read_arrays(out)


def _ask(request: Mapping[str, Any], *, wait: float) -> dict[str, Any]:
    """Send a request to the child and wait for its answer."""
    child = _running_child()
    assert child.stdin is not None
    assert child.stdout is not None
    late = threading.Event()

    def give_up() -> None:
        late.set()
        child.kill()

    timer = threading.Timer(wait, give_up)
    timer.daemon = True
    timer.start()
    try:
        child.stdin.write(json.dumps(request).encode() + b"\n")
        child.stdin.flush()
        line = child.stdout.readline()
        if line.endswith(b"\n"):
            answer: dict[str, Any] = json.loads(line)
            return answer
    except (BrokenPipeError, ValueError):
        pass
    except BaseException:  # interrupted: its answer must not be taken for the next one
        _stop(child)
        raise
    finally:
        timer.cancel()
    _stop(child)
    return {"error": f"no end of reading within {wait:.0f} s" if late.is_set() else _how_it_ended(child.returncode)}


def _running_child() -> "subprocess.Popen[bytes]":
    child = _child.get(os.getpid())
    if child is not None and child.poll() is None:
        return child
    command = f"import sys; sys.path.insert(0, {str(_ROOT)!r}); import mixpinn.base.reader_process as r; r.serve()"
    child = subprocess.Popen(
        [sys.executable, "-c", command], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        # One thread and one arena: what a thread reserves would count as memory of the file.
        env={**os.environ, "OMP_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "1", "VTK_SMP_MAX_THREADS": "1"},
    )
    _child.clear()
    _child[os.getpid()] = child
    return child


def _stop(child: "subprocess.Popen[bytes]") -> None:
    """End the child, which has ended, hangs, or is out of step; how it ended by itself is kept."""
    with contextlib.suppress(subprocess.TimeoutExpired):
        child.wait(0.5)
    child.kill()
    child.wait()
    for pipe in (child.stdin, child.stdout):
        if pipe is not None:
            with contextlib.suppress(OSError):
                pipe.close()
    _child.clear()


@atexit.register
def _end() -> None:
    child = _child.get(os.getpid())
    if child is not None:
        child.kill()
        _stop(child)


def _how_it_ended(code: int | None) -> str:
    if code is not None and code < 0:
        name = signal.Signals(-code).name
        if name == "SIGXCPU":
            return "no end of reading within its processor time"
        return f"the reader ended by {name}, which damaged files cause"
    return f"the reader ended with exit code {code}, which damaged files cause"


def serve() -> None:
    """Answer requests on standard input until it ends: what the child runs."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # its parent decides
    replies = os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)  # libraries write to standard output
    sys.stdout = open(os.devnull, "w")  # noqa: SIM115 (open as long as the process)
    for line in sys.stdin.buffer:
        replies.write(json.dumps(_answer(json.loads(line))).encode() + b"\n")
        replies.flush()


def _answer(request: Mapping[str, Any]) -> dict[str, Any]:
    try:
        reader: Reader = getattr(importlib.import_module(request["module"]), request["function"])
        _limit(int(request["memory"]), float(request["seconds"]))
        arrays, about = reader(Path(request["path"]))
        write_arrays(request["out"], arrays, about=about)
    except BaseException as error:  # libraries end the interpreter, too
        text = " ".join(str(error).split())
        return {"error": f"{type(error).__name__}: {text[:300]}" if text else type(error).__name__}
    return {"done": True}


def _limit(memory: int, seconds: float) -> None:
    """Let this process take so much more memory [byte] and processor time [s]."""
    try:
        import resource
    except ImportError:  # Windows
        return
    used = resource.getrusage(resource.RUSAGE_SELF)
    with contextlib.suppress(ValueError, OSError):  # where the system sets lower limits of its own
        hard = resource.getrlimit(resource.RLIMIT_CPU)[1]
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(used.ru_utime + used.ru_stime + seconds), hard))
    with contextlib.suppress(ValueError, OSError):
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + memory, hard))
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
