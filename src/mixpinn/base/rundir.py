"""Run directories: a stage's output folder that says what made it, and lets an interrupted stage go on."""

import importlib.metadata
import platform
import sys
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from mixpinn.base.errors import InputError
from mixpinn.base.files import hash_file, is_foreign, make_folder, read_json, write_json
from mixpinn.base.lock import acquire, given_back, release
from mixpinn.base.manifest import MANIFEST

RECORD = "run.json"
_begun: list[tuple[Path, bool]] = []
"""Run directories that this process began, and whether the folder was there before."""
_PACKAGES = ("mixpinn", "numpy", "scipy", "numba", "torch", "torch-geometric", "zarr", "pyvista", "nibabel")


def versions() -> dict[str, str]:
    """Versions of Python, the platform and the packages that decide results."""
    found = {"python": platform.python_version(), "platform": platform.platform()}
    for name in _PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def _hash_inputs(inputs: Mapping[str, Path | str]) -> dict[str, str]:
    hashes = {}
    for name, path in inputs.items():
        path = Path(path)
        if path.is_file():
            hashes[name] = hash_file(path)
        elif path.is_dir():
            hashes.update({f"{name}/{p.name}": hash_file(p) for p in _visible_files(path)})
    return hashes


def _visible_files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.is_file() and not is_foreign(path.name))


run_scope = given_back
"""``@run_scope()`` before a stage: the run directories that it opens are let go when it ends, however it ends."""


def start_run(
    folder: Path | str, stage: str, config: Any, *, inputs: Mapping[str, Path | str] | None = None,
    seed: int | None = None, input_hashes: Mapping[str, str] | None = None,
) -> bool:
    """Open `folder` as the run directory of `stage`; write ``run.json`` with all that the result depends on.

    Returns:
        True where the same run was begun here before (same stage, configuration, seed and inputs), so that
        finished work may be kept; False where the folder is new.

    Raises:
        InputError: the folder holds another run or an artefact, its path is that of a file, or another process works
            in it. This process keeps the folder to itself until `finish_run`, the end of the `run_scope` around, or its
            own end.
    """
    folder = Path(folder)
    existed = folder.is_dir()
    make_folder(folder)
    settings = asdict(config) if is_dataclass(config) and not isinstance(config, type) else dict(config)
    identity = {
        "stage": stage, "seed": seed, "config": _jsonable(settings),
        "inputs": {**_hash_inputs(inputs or {}), **(input_hashes or {})},
    }
    acquire(folder)
    record = folder / RECORD
    if record.exists():
        before = read_run(folder)
        if {key: before.get(key) for key in identity} == identity:
            return True
        changed = ", ".join(key for key in identity if before.get(key) != identity[key])
        release(folder)
        raise InputError(
            str(folder), expected=f"an empty folder or the same {stage} run", got=f"a run with another {changed}",
            fix="choose another output folder or delete this one",
        )
    if (folder / MANIFEST).exists():
        release(folder)
        raise InputError(
            str(folder), expected=f"an empty folder or the same {stage} run",
            got=f"a folder with files that {MANIFEST} vouches for", fix="choose another output folder",
        )
    write_json(record, {
        **identity, "command": sys.argv, "versions": versions(),
        "input_paths": {name: str(path) for name, path in (inputs or {}).items()},
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
    })
    _begun.append((folder.absolute(), existed))
    return False


def withdraw_unused_runs() -> None:
    """Undo the runs that this process began and that hold no more than their record.

    Bad input may be found only after a run was begun; without results the record would stand in the way of the
    corrected run.
    """
    while _begun:
        folder, existed = _begun.pop()
        release(folder)
        if folder.is_dir() and [path.name for path in folder.iterdir() if not is_foreign(path.name)] == [RECORD]:
            (folder / RECORD).unlink()
            if not existed:
                folder.rmdir()


def finish_run(folder: Path | str, results: Mapping[str, Any]) -> None:
    """Add `results` and the time of completion to the run's record, and let other processes in."""
    record = Path(folder) / RECORD
    write_json(record, {
        **read_run(folder), "results": dict(results), "finished": datetime.now(UTC).isoformat(timespec="seconds"),
    })
    release(folder)


def is_finished(folder: Path | str) -> bool:
    """Whether the run directory holds a completed run."""
    record = Path(folder) / RECORD
    return record.exists() and "finished" in read_run(folder)


def read_run(folder: Path | str) -> dict[str, Any]:
    """What `start_run` and `finish_run` wrote.

    Raises:
        InputError: absent, or damaged.
    """
    record = Path(folder) / RECORD
    values = read_json(record)
    if not isinstance(values, dict) or not isinstance(values.get("config"), dict):
        raise InputError(
            str(record), expected="the record of a run", got="something else", fix="choose another output folder",
        )
    return values


def _jsonable(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _jsonable(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_jsonable(item) for item in value]
    return str(value) if isinstance(value, Path) else value
