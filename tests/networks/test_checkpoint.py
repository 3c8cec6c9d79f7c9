"""Model folders: bit-exact round trip, refusal of other topologies and of damage, and no code that runs."""

import io
import json
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from mixpinn.base.errors import InputError
from mixpinn.graph import Scaling
from mixpinn.networks import (
    ABLATION,
    MIXPINN,
    ModelConfig,
    build_graph_for,
    build_model,
    load_checkpoint,
    model_name,
    read_description,
    save_checkpoint,
)
from mixpinn.networks.checkpoint import NETWORK
from training.toy_block import TINY, block_mesh

CONFIGS = {
    "virtual nodes": TINY,
    "virtual edges, edge features, REL, scaled": ModelConfig(
        layers=2, heads=1, hidden=4, edge_features=True, virtual_edges=True, rel_weight=1.0, scaling=Scaling.STANDARD,
    ),
    "physgnn": ModelConfig(architecture="physgnn", hidden=6),
}


def saved(folder: Path, config: ModelConfig = TINY) -> torch.Tensor:
    """Write a model; returns what it answers to the probing field."""
    mesh = block_mesh()
    model = build_model(config, build_graph_for(config, mesh), seed=4).eval()
    model.fit_scaling(torch.linspace(-1.0, 2.0, 2 * 125 * 3).view(2, 125, 3))
    save_checkpoint(folder, model, config, mesh, training={"epochs": 3})
    with torch.no_grad():
        return model(probing())


def probing() -> torch.Tensor:
    """A contact field, shape (1, 125, 3)."""
    return torch.sin(torch.arange(375.0)).view(1, 125, 3)


@pytest.mark.parametrize("config", CONFIGS.values(), ids=CONFIGS)
def test_a_loaded_model_answers_bit_for_bit_the_same(tmp_path: Path, config: ModelConfig) -> None:
    expected = saved(tmp_path, config)
    for mesh in (None, block_mesh()):
        model, graph, loaded = load_checkpoint(tmp_path, mesh=mesh)
        assert loaded == config
        assert graph.mesh_hash == block_mesh().hash()
        assert not model.training
        with torch.no_grad():
            assert torch.equal(model(probing()), expected)
    assert read_description(tmp_path)["training"] == {"epochs": 3}


def test_another_topology_is_refused(tmp_path: Path) -> None:
    saved(tmp_path)
    mesh = block_mesh()
    relabelled = replace(mesh, part=np.where(mesh.part == 2, 0, mesh.part).astype(np.int16))
    for other in (block_mesh(1.0), replace(mesh, cells=mesh.cells[1:]), relabelled):
        with pytest.raises(InputError, match=r"a model of linear tetrahedra.* got one of linear tetrahedra"):
            load_checkpoint(tmp_path, mesh=other)
    block_mesh(1.0).save(tmp_path / "mesh.vtu")
    with pytest.raises(InputError, match="altered after it was made"):
        load_checkpoint(tmp_path)
    NETWORK.seal(tmp_path, FILES)
    with pytest.raises(InputError, match=r"a model of linear tetrahedra.* got one of linear tetrahedra"):
        load_checkpoint(tmp_path)


def test_a_model_saved_over_one_of_another_mesh_brings_its_own(tmp_path: Path) -> None:
    saved(tmp_path)
    other = block_mesh(1.0)
    save_checkpoint(tmp_path, build_model(TINY, build_graph_for(TINY, other)), TINY, other)
    assert load_checkpoint(tmp_path)[1].mesh_hash == other.hash()


def rewrite(change: Callable[[dict[str, Any]], object]) -> Callable[[Path], None]:
    """A change of ``model.json``."""
    def apply(folder: Path) -> None:
        values = json.loads((folder / "model.json").read_text())
        change(values)
        (folder / "model.json").write_text(json.dumps(values))
    return apply


FILES = ("weights.safetensors", "model.json", "mesh.vtu")
DAMAGE: dict[str, tuple[Callable[[Path], object], str]] = {
    "truncated weights": (
        lambda f: (f / "weights.safetensors").write_bytes((f / "weights.safetensors").read_bytes()[:-10]), "damaged",
    ),
    "empty weights": (lambda f: (f / "weights.safetensors").write_bytes(b""), "damaged"),
    "pickled weights": (lambda f: torch.save({"a": torch.zeros(1)}, f / "weights.safetensors"), "damaged"),
    "no weights": (lambda f: (f / "weights.safetensors").unlink(), "no such file"),
    "no mesh": (lambda f: (f / "mesh.vtu").unlink(), "no such file"),
    "no description": (lambda f: (f / "model.json").unlink(), "no such file"),
    "truncated description": (lambda f: (f / "model.json").write_text('{"format": 1'), "valid JSON"),
    "other JSON": (lambda f: (f / "model.json").write_text("[]"), "model description"),
    "future format": (rewrite(lambda v: v.update(format=99)), "format 1"),
    "unknown setting": (rewrite(lambda v: v["config"].update(colour="red")), "colour"),
    "wrong type": (rewrite(lambda v: v["config"].update(layers="eight")), "layers"),
    "unknown architecture": (rewrite(lambda v: v["config"].update(architecture="os.system")), "architecture"),
    "another width": (rewrite(lambda v: v["config"].update(hidden=9)), "weights of the network"),
    "another depth": (rewrite(lambda v: v["config"].update(layers=3)), "weights of the network"),
}


@pytest.mark.parametrize(("damage", "message"), DAMAGE.values(), ids=DAMAGE)
def test_damaged_folders_are_refused_in_one_line(
    tmp_path: Path, damage: Callable[[Path], object], message: str,
) -> None:
    saved(tmp_path)
    damage(tmp_path)
    if all((tmp_path / name).is_file() for name in FILES):
        # The manifest notices every alteration; here one was written for the altered files.
        with pytest.raises(InputError, match="altered after it was made"):
            load_checkpoint(tmp_path)
        NETWORK.seal(tmp_path, FILES)
    with pytest.raises(InputError, match=message) as raised:
        load_checkpoint(tmp_path)
    assert "\n" not in str(raised.value)


def test_loading_never_unpickles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = saved(tmp_path)

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("unpickled")

    for name in ("load", "loads", "Unpickler", "_Unpickler"):
        monkeypatch.setattr(pickle, name, refuse)
    monkeypatch.setattr(torch, "load", refuse)
    monkeypatch.setattr("builtins.eval", refuse)
    with pytest.raises(AssertionError, match="unpickled"):
        pickle.load(io.BytesIO(b"."))  # the trap is set
    model, _, _ = load_checkpoint(tmp_path)
    with torch.no_grad():
        assert torch.equal(model(probing()), expected)


def test_names_of_models_do_not_depend_on_their_size() -> None:
    assert model_name(MIXPINN) == "mixpinn"
    assert model_name(replace(ABLATION[7], hidden=32, layers=6, scaling=Scaling.STANDARD)) == "row-7"
    assert model_name(replace(MIXPINN, heads=5)) is None
