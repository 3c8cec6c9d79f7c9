"""Model folders: a trained network with its configuration, its mesh and how it was trained."""

import contextlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from mixpinn.base.errors import InputError
from mixpinn.base.files import read_json, write_json
from mixpinn.base.manifest import Artefact
from mixpinn.base.rundir import versions
from mixpinn.base.validated import ArraySpec, checked_record
from mixpinn.graph import MeshGraph
from mixpinn.networks.config import MODELS, ModelConfig
from mixpinn.networks.displacement_model import DisplacementModel, build_graph_for, build_model, parameter_shapes
from mixpinn.networks.tensor_file import read_tensors, write_tensors
from mixpinn.records import MESH_FILE, TissueMesh
from mixpinn.records.answer import discretisation_of

_versions = cache(versions)
MODEL_FILE, WEIGHTS_FILE = "model.json", "weights.safetensors"
NETWORK = Artefact("trained network", 1, "train the model again, or copy its folder again")
_FORMAT = 1


@dataclass(frozen=True)
class _Description:
    """What ``model.json`` holds."""

    format: int
    config: dict[str, Any]
    mesh_hash: str
    training: dict[str, Any]
    versions: dict[str, str]
    discretisation: str = ""


def save_checkpoint(
    folder: Path | str, model: DisplacementModel, config: ModelConfig, mesh: TissueMesh, *,
    training: Mapping[str, Any] | None = None,
) -> None:
    """Write a model folder: ``weights.safetensors``, ``model.json`` and ``mesh.vtu``, each atomically.

    Args:
        folder: where to; an older model there is replaced.
        model: the network; its buffers (scaling statistics among them) are stored with the weights.
        config: what `build_model` built it from.
        mesh: what `build_graph_for` built its graph from.
        training: summary for the reader, as plain types.
    """
    folder = Path(folder)
    mesh_hash = mesh.hash()
    same_mesh = False
    with contextlib.suppress(InputError):  # a model that is absent or damaged is written whole
        NETWORK.check(folder, MESH_FILE)
        same_mesh = read_description(folder)["mesh_hash"] == mesh_hash
    if not same_mesh:
        mesh.save(folder / MESH_FILE)
    write_tensors(folder / WEIGHTS_FILE, model.state_dict(), about={"mesh_hash": mesh_hash})
    describe_training(folder, config, mesh, training or {})


def describe_training(folder: Path | str, config: ModelConfig, mesh: TissueMesh, training: Mapping[str, Any]) -> None:
    """Write ``model.json`` alone: the weights stay, what is said about their training changes."""
    write_json(Path(folder) / MODEL_FILE, {
        "format": _FORMAT, "config": asdict(config), "mesh_hash": mesh.hash(),
        "discretisation": discretisation_of(mesh), "training": dict(training), "versions": _versions(),
    })
    NETWORK.seal(folder, [name for name in (WEIGHTS_FILE, MODEL_FILE, MESH_FILE) if (Path(folder) / name).is_file()])


def read_description(folder: Path | str) -> dict[str, Any]:
    """Read ``model.json``: keys ``config``, ``mesh_hash``, ``training``, ``versions``.

    Raises:
        InputError: absent, not JSON, or of another format.
    """
    path = Path(folder) / MODEL_FILE
    NETWORK.check(folder, MODEL_FILE)
    values = read_json(path)
    if not isinstance(values, dict) or values.get("format") != _FORMAT:
        raise InputError(
            str(path), expected=f"a model description of format {_FORMAT}", got="something else",
            fix="give the folder that 'mixpinn train' wrote",
        )
    return asdict(checked_record(_Description, values, str(path), remake=NETWORK.remake))


def load_checkpoint(
    folder: Path | str, *, mesh: TissueMesh | None = None,
) -> tuple[DisplacementModel, MeshGraph, ModelConfig]:
    """Read a model folder. Nothing in it is executed: JSON, safetensors and VTU hold data only.

    Args:
        folder: what `save_checkpoint` wrote.
        mesh: the mesh that the model is to be used on; None takes the folder's own.

    Returns:
        the network in evaluation mode on the CPU, the graph that it reads, and its configuration.

    Raises:
        InputError: a file is absent, damaged or altered; a setting is unknown; the mesh or the weights are those
            of another topology.
    """
    folder = Path(folder)
    description = read_description(folder)
    where = f"{folder / MODEL_FILE}: config"
    config = checked_record(ModelConfig, description["config"], where, remake=NETWORK.remake)
    mesh = mesh or load_network_mesh(folder)
    if mesh.hash() != description["mesh_hash"]:
        raise InputError(
            str(folder), expected=f"a model of {discretisation_of(mesh)}",
            got=f"one of {description['discretisation'] or 'mesh ' + description['mesh_hash']}",
            fix="train on this mesh or choose the model that was",
        )
    NETWORK.check(folder, WEIGHTS_FILE)
    tensors, _ = read_tensors(folder / WEIGHTS_FILE)
    graph = build_graph_for(config, mesh)
    where = str(folder / WEIGHTS_FILE)
    for name, shape in parameter_shapes(config, graph).items():  # compared before a network of any size is made
        found = None if name not in tensors else tuple(tensors[name].shape)
        if found != shape:
            raise InputError(
                where, expected=f"the weights of the network that model.json describes, {name} of shape {shape}",
                got="none" if found is None else str(found), fix=NETWORK.remake,
            )
        ArraySpec("number", shape).check(
            tensors[name].numpy(), f"{where}: {name}", extents={}, remake=NETWORK.remake,
        )
    model = build_model(config, graph)
    try:
        model.load_state_dict(tensors)
    except RuntimeError as error:
        raise InputError(
            str(folder / WEIGHTS_FILE), expected="the weights of the network that model.json describes",
            got=str(error).partition("\n")[2].strip() or str(error), fix="copy or train the model again",
        ) from error
    return model.eval(), graph, config


def load_network_mesh(folder: Path | str) -> TissueMesh:
    """The mesh of a model folder.

    Raises:
        InputError: absent or altered.
    """
    NETWORK.check(folder, MESH_FILE)
    return TissueMesh.load(Path(folder) / MESH_FILE)


def model_name(config: ModelConfig) -> str | None:
    """Name in `MODELS` of the first model like `config`; depth, width and scaling do not matter. None without one."""
    own = ("layers", "hidden", "scaling")
    return next((
        name for name, listed in MODELS.items()
        if replace(config, **{setting: getattr(listed, setting) for setting in own}) == listed
    ), None)
