"""A damaged value in any JSON or table that is read back is refused in one line that names the file."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mixpinn.anatomy.finding import Finding
from mixpinn.base.errors import InputError
from mixpinn.base.files import write_json, write_text
from mixpinn.dataset import DatasetTable, Split
from mixpinn.dataset.inverted_cells import _known
from mixpinn.mesh.checks.fidelity import MeshFidelity, StructureFidelity
from mixpinn.mesh.checks.quality import mesh_quality
from mixpinn.mesh.checks.statistics import mesh_statistics
from mixpinn.networks import build_graph_for, build_model, load_checkpoint, save_checkpoint
from mixpinn.networks.checkpoint import NETWORK
from mixpinn.pipeline import onboarding, run
from mixpinn.records import LabelMap
from mixpinn.records.joint_frame import JOINTS_FILE, save_joint_frames
from mixpinn.records.label_map import label_map_files
from mixpinn.reduced.error_estimate import ErrorEstimate
from mixpinn.stages import anatomy
from mixpinn.stages.mesh import MESH_RUN, MESH_RUN_FILES, MeshResult
from mixpinn.training import read_history
from training.toy_block import TINY, block_mesh

NAN = float("nan")


def write_mesh(folder: Path) -> None:
    mesh = block_mesh()
    mesh.save(folder / "mesh.vtu")
    write_json(folder / "statistics.json", mesh_statistics(mesh))
    write_json(folder / "quality.json", mesh_quality(mesh))
    write_json(folder / "fidelity.json", MeshFidelity((StructureFidelity("body", 0.9, 1.0, 0.1),)))
    write_text(folder / "statistics.md", "")
    save_joint_frames([], folder / JOINTS_FILE)
    MESH_RUN.seal(folder, MESH_RUN_FILES)


def write_network(folder: Path) -> None:
    mesh = block_mesh()
    save_checkpoint(folder, build_model(TINY, build_graph_for(TINY, mesh)), TINY, mesh)


def write_labels(folder: Path) -> None:
    labels = np.zeros((3, 3, 3), dtype=np.uint8)
    labels[1, 1, 1] = 1
    LabelMap(labels, np.eye(4), np.eye(4), ("body",), ("L1",)).save(folder / "labels.nii.gz")


def write_findings(folder: Path) -> None:
    write_labels(folder)
    write_json(folder / "findings.json", [asdict(Finding("hole", "body", "enclosed background", 3))])


ESTIMATE = ErrorEstimate(np.zeros(6), 2.0, 0.95, np.eye(2), 3.0)


@dataclass(frozen=True)
class Kind:
    """A file: how it is written, how it is read, and how its manifest is renewed after it was damaged."""

    write: Callable[[Path], object]
    read: Callable[[Path], object]
    seal: Callable[[Path], object] = lambda folder: None


KINDS = {
    "split.json": Kind(
        lambda f: Split("a", np.array([0, 1]), np.array([2]), np.array([3])).save(f / "split.json"),
        lambda f: Split.load(f / "split.json"),
    ),
    "model.json": Kind(
        write_network, load_checkpoint, lambda f: NETWORK.seal(f, ["weights.safetensors", "model.json", "mesh.vtu"]),
    ),
    **{name: Kind(write_mesh, MeshResult.load, lambda f: MESH_RUN.seal(f, MESH_RUN_FILES)) for name in (
        "statistics.json", "quality.json", "fidelity.json",
    )},
    "labels.json": Kind(
        write_labels, lambda f: LabelMap.load(f / "labels.nii.gz"),
        lambda f: label_map_files(f / "labels.nii.gz").seal(f, ["labels.nii.gz", "labels.json"]),
    ),
    "error.json": Kind(
        lambda f: write_json(f / "error.json", ESTIMATE.as_dict()),
        lambda f: ErrorEstimate.of_dict(
            json.loads((f / "error.json").read_text()), str(f / "error.json"), coordinates=2, remake="fit again",
        ),
    ),
    "table.json": Kind(
        lambda f: DatasetTable("a", (2, 1, 1, 4), (4, 2, 2, 8), (16, 8, 8, 32)).save(f / "table.json"),
        lambda f: DatasetTable.load(f / "table.json"),
    ),
    "findings.json": Kind(
        write_findings, lambda f: anatomy._load(f),
    ),
    "rounds.json": Kind(
        lambda f: onboarding._Clock(f / "rounds.json").note({"stage": "prior", "minutes": 1.0}),
        lambda f: onboarding._Clock(f / "rounds.json"),
    ),
    "stage_seconds.json": Kind(
        lambda f: run._Clock(f / "stage_seconds.json").measure("Mesh", lambda: None),
        lambda f: run._Clock(f / "stage_seconds.json"),
    ),
}
DAMAGE: list[tuple[str, list[Any], Any]] = [
    *(("split.json", path, value) for path, value in (
        (["train"], None), (["test"], [[1]]), (["validation", 0], NAN), (["train", 0], 1 << 70), (["train", 0], -1),
        (["train", 0], "0"), (["train", 0], 0.5),
    )),
    *(("model.json", path, value) for path, value in (
        (["config", "layers"], 10**9), (["config", "layers"], NAN), (["config", "hidden"], 10**30),
        (["config", "heads"], "two"), (["config", "rel_weight"], NAN), (["config", "rel_weight"], [1.0]),
        (["config"], 3), (["mesh_hash"], None), (["training"], []), (["format"], "1"),
    )),
    *((name, path, value) for name, path in (
        ("statistics.json", ["cells"]), ("quality.json", ["min_dihedral"]), ("quality.json", ["slivers"]),
        ("fidelity.json", ["structures", 0, "dice"]),
    ) for value in (NAN, None, "1", [1.0])),
    *(("labels.json", path, value) for path, value in (
        (["affine", 0, 0], NAN), (["affine"], [[1.0]]), (["world_to_scanner"], None), (["soft_names"], "body"),
        (["rigid_names"], [3]),
    )),
    *(("error.json", path, value) for path, value in (
        (["coefficients", 0], NAN), (["coefficients"], [1.0]), (["spread"], [[1.0, 0.0], [1.0]]), (["spread"], [[1.0]]),
        (["factor"], "2"), (["level"], None), (["farthest"], float("inf")),
    )),
    *(("table.json", path, value) for path, value in (
        (["samples"], [1, 2, 3]), (["poses", 0], -1), (["poses", 0], "4"), (["positions"], None), (["split"], 3),
    )),
    *(("findings.json", [0, *path], value) for path, value in (
        (["kind"], "unheard of"), (["voxels"], "3"), (["structure"], None), (["error"], "no"),
    )),
    ("rounds.json", ["seconds"], NAN), ("rounds.json", ["rounds"], {}), ("rounds.json", ["seconds"], None),
    ("stage_seconds.json", ["Mesh"], "long"), ("stage_seconds.json", ["Mesh"], NAN),
]


@pytest.mark.parametrize("name", KINDS)
def test_what_is_sound_is_read_and_what_is_cut_short_or_of_another_kind_is_not(tmp_path: Path, name: str) -> None:
    kind, path = KINDS[name], tmp_path / name
    kind.write(tmp_path)
    kind.read(tmp_path)
    for text in ("[3]", "7"):
        path.write_text(text)
        kind.seal(tmp_path)
        if name != "error.json":  # which is a part of another file
            refused(kind, tmp_path, name)


@pytest.mark.parametrize(("name", "place", "value"), DAMAGE)
def test_a_damaged_value_is_refused(tmp_path: Path, name: str, place: list[Any], value: Any) -> None:
    """`value` stands where it should not; None takes the entry away."""
    kind, path = KINDS[name], tmp_path / name
    kind.write(tmp_path)
    values = json.loads(path.read_text())
    inner = values
    for key in place[:-1]:
        inner = inner[key]
    if value is None:
        del inner[place[-1]]
    else:
        inner[place[-1]] = value
    path.write_text(json.dumps(values))
    kind.seal(tmp_path)
    refused(kind, tmp_path, name)


def refused(kind: Kind, folder: Path, name: str) -> None:
    with pytest.raises(InputError) as caught:
        kind.read(folder)
    message = str(caught.value)
    assert "\n" not in message
    assert name in message or "model." in message


@pytest.mark.parametrize("row", ["1,nan,1,1,1", "1,1,inf,1,1", "0,1,1,1,1", "1,1,1,1", "one,1,1,1,1", "1.5,1,1,1,1"])
def test_a_damaged_row_of_the_history_is_refused(tmp_path: Path, row: str) -> None:
    head = "epoch,train_loss,validation_loss,learning_rate,seconds\n"
    (tmp_path / "history.csv").write_text(f"{head}{row}\n")
    with pytest.raises(InputError, match=r"history\.csv") as caught:
        read_history(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("values", [
    [], {"pose": 3}, {"pose": {"hash": "a"}}, {"pose": {"hash": "a", "cells": [{"pose": "p", "cell": "x"}]}},
    {"pose": {"hash": NAN, "cells": []}},
])
def test_a_damaged_list_of_inverted_cells_is_made_anew(tmp_path: Path, values: Any) -> None:
    (tmp_path / "inverted.json").write_text(json.dumps(values))
    assert _known(tmp_path / "inverted.json") == {}
