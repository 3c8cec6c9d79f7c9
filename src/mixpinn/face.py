"""The public face: the typical jobs as a few functions, from label maps to an answer.

``import mixpinn as mx`` brings all of them; the libraries behind a job are imported when the job is done.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mixpinn.base.arrays import AnyArray
from mixpinn.records.answer import Answer
from mixpinn.records.label_map import LabelMap
from mixpinn.records.tissue_mesh import TissueMesh

if TYPE_CHECKING:
    from mixpinn.dataset.protocol import Protocol
    from mixpinn.dataset.store import SimulationStore
    from mixpinn.fem.material.hyperelastic import Material
    from mixpinn.fem.scene import Scene
    from mixpinn.serving.load import AnyPredictor
    from mixpinn.stages.samples import SplitConfig
    from mixpinn.stages.training import ModelsConfig


def load_anatomy(
    source: Path | str, *, repair: bool = False, names: Path | str | None = None, body: str | None = None,
    rigid: Sequence[str] | None = None, target: Sequence[str] | None = None, paper_parts: bool = False,
    soft: Sequence[str] = (), out: Path | str | None = None,
) -> LabelMap:
    """Read, check and crop an anatomy, and place it in the world frame.

    Args:
        source: folder with one label image a structure, one multi-label image, or ``phantom``.
        repair: mend what the label check finds.
        names: name table of a multi-label image; by default its header's names, else those of TotalSegmentator 2.
        body: name of the body, or a file; by default found by name.
        rigid: names of the rigid parts; by default every bone of the maps inside the crop.
        target: rigid parts that the crop follows; by default the lumbar vertebrae.
        paper_parts: only the lumbar vertebrae are rigid, as in the paper.
        soft: names of further soft tissues.
        out: run directory, also with a picture and the findings; nothing is written without it.

    Raises:
        InputError: the label maps are not usable, or have errors that were not repaired.
    """
    from mixpinn.base.config import build_config
    from mixpinn.stages.anatomy import AnatomyConfig, make_anatomy, source_settings

    settings = build_config(AnatomyConfig, source_settings(source), {
        "repair": repair, "names": names and str(names), "body": body, "rigid": rigid and tuple(rigid),
        "soft": tuple(soft), "target": target and tuple(target), "paper_parts": paper_parts,
    })
    return make_anatomy(settings, out=out).label_map


def make_mesh(
    labels: LabelMap | Path | str, *, size: float = 1.0, out: Path | str | None = None,
) -> TissueMesh:
    """Tetrahedra of the soft tissue, with the rigid parts as cavities.

    Args:
        labels: the anatomy, or the path of a ready mesh (.vtu).
        size: 1 is the paper's resolution, larger is coarser.
        out: run directory, also with statistics, quality, fidelity and a picture; nothing is written without it.

    Raises:
        InputError: the labels cannot be meshed.
    """
    from mixpinn.stages.mesh import MeshConfig
    from mixpinn.stages.mesh import make_mesh as make

    return make(labels, MeshConfig(size=size), out=out).mesh


def solve_pose(
    scene: "Scene", *, tip: AnyArray | Sequence[float], rotation_deg: float = 0.0,
    direction: AnyArray | Sequence[float] = (0.0, -1.0, 0.0), rotation: AnyArray | None = None,
    history: object | None = None,
) -> Answer:
    """One full solve: the probe pressed to a pose, with contact and friction.

    Without a history the path is straight along the pressing direction, from first touch to `tip` in steps of 1 mm;
    with the history of an earlier answer it begins at that one.

    Args:
        scene: what is pressed with what.
        tip: where the probe's tip ends, world [mm], shape (3,).
        rotation_deg: rotation of the probe about the pressing direction [degree].
        direction: where it presses to, of any length, shape (3,).
        rotation: rotation matrix of the probe instead of these two, shape (3, 3).
        history: `Answer.history` of an earlier full solve of this scene.

    Raises:
        InputError: a pose that is not finite, or the history of something else.
    """
    from mixpinn.fem.solve.pose import solve_pose as solve
    from mixpinn.geometry.probe_pose import probe_rotation

    if rotation is None:
        rotation = probe_rotation(rotation_deg, np.asarray(direction, dtype=np.float64))
    return solve(scene, np.asarray(tip, dtype=np.float64), np.asarray(rotation, dtype=np.float64), history=history)


def simulate(
    scene: "Scene", protocol: "Protocol", *, out: Path | str, positions: Path | str | None = None, workers: int = 0,
) -> "SimulationStore":
    """Press the probe over all poses of a protocol; finished poses are kept if the call is interrupted.

    Args:
        scene: what is pressed with what.
        protocol: rotations, depths and path.
        out: run directory.
        positions: file with one probe position ``x y z`` [mm] a line; None for a grid over the rigid parts.
        workers: processes; 0 takes every core.

    Raises:
        InputError: bad settings, no skin in the probe's way, or `out` holds another run.
    """
    from dataclasses import replace

    from mixpinn.stages.simulation import make_simulations, settings_of_scene

    settings = replace(
        settings_of_scene(scene, protocol), workers=workers, positions=None if positions is None else str(positions),
    )
    return make_simulations(scene.mesh, settings, out=out, scene=scene)[0]


def fit(
    model: str, store: "SimulationStore | Path | str", *, out: Path | str, settings: "ModelsConfig | None" = None,
    split: "SplitConfig | None" = None, materials: "Sequence[Material] | None" = None,
    held_out: str | None = None, devices: int = 1,
) -> "AnyPredictor":
    """Fit one model on the training positions of a store; an interrupted run continues.

    Args:
        model: ``hybrid``, or a network of the paper's tables: ``mixpinn``, ``simple-gat``, ``physgnn`` or ``row-1`` …
            ``row-13``.
        store: the simulations, or their folder.
        out: run directory: what `load` reads.
        settings: width, scaling, optimizer; modes and regression of the hybrid model.
        split: of the positions.
        materials: one for each tissue, where the store cannot tell them: a class of one's own.
        held_out: a hold-out by name whose samples the fit does not see.
        devices: processes of a network's training, each with a device of its own.

    Raises:
        InputError: an unknown name, simulations that are not finished, or `out` holds another run.
    """
    from mixpinn.dataset import SimulationStore
    from mixpinn.stages.fit import fit_model
    from mixpinn.stages.samples import SplitConfig, load_samples
    from mixpinn.stages.training import ModelsConfig

    opened = store if isinstance(store, SimulationStore) else SimulationStore.open(simulations_folder(store))
    table, parts = load_samples(opened, split or SplitConfig())
    fit_model(
        opened, table, parts, model, settings or ModelsConfig(names=(model,)), out=out, materials=materials,
        devices=devices, held_out=held_out,
    )
    return load(out)


def load(folder: Path | str, *, threads: int | None = None, warm_up: bool = True) -> "AnyPredictor":
    """Load what `fit` or 'mixpinn train' wrote: a hybrid model, which takes poses too, or a network.

    Args:
        folder: of the model.
        threads: CPU threads of a prediction; None leaves them as they are.
        warm_up: make one prediction, so that the next one is not slowed down by compilation.

    Raises:
        InputError: the folder is incomplete or damaged.
    """
    from mixpinn.serving.load import load_predictor

    return load_predictor(folder, threads=threads, warm_up=warm_up)


def simulations_folder(folder: Path | str) -> Path:
    """The store inside the run directory of `simulate`, or the store itself.

    Raises:
        InputError: neither.
    """
    from mixpinn.base.errors import InputError

    for candidate in (Path(folder) / "store", Path(folder)):
        if (candidate / "store.json").exists():
            return candidate
    raise InputError(
        str(folder), expected="simulations", got="no store.json", fix="give the folder that 'mixpinn simulate' wrote",
    )
