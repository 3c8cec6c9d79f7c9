"""Scenes to SOFA and recordings from SOFA, as run directories like those of our own simulations."""

from dataclasses import asdict
from pathlib import Path

import numpy as np

from mixpinn.base.errors import InputError
from mixpinn.base.lock import locked
from mixpinn.base.rundir import finish_run, is_finished, run_scope, start_run
from mixpinn.dataset import SOFA_REPLAY, Pose, SimulationStore, probe_path, read_positions, summarise
from mixpinn.fem import StableNeoHookean
from mixpinn.interop import SofaConstants, SofaSettings, export_sofa_scene, import_sofa
from mixpinn.physics.restraints import FREE
from mixpinn.records import TissueMesh
from mixpinn.stages.simulation import STORE, SimulationConfig, make_scene, plan


def export_sofa(mesh: TissueMesh, config: SimulationConfig, *, out: Path | str) -> Path:
    """Write the scene that `make_simulations` would simulate as a SOFA scene with a recorder.

    Returns:
        Path of ``scene.py``.

    Raises:
        InputError: a tissue that SOFA's Stable Neo-Hookean does not describe, joints, foundations or held parts.
    """
    scene = make_scene(mesh, config)
    mesh = scene.mesh
    if scene.restraints != FREE:
        raise InputError(
            "export to SOFA", expected="a scene without joints and foundations", got="one with them",
            fix="give --joints none and --support anterior: the exported scene would leave them out",
        )
    if mesh.held_parts.any():
        raise InputError(
            "export to SOFA", expected="rigid parts that move", got="held ones", fix="set support.cut to free",
        )
    if not all(isinstance(material, StableNeoHookean) for material in scene.materials):
        raise InputError(
            "tissue", expected="the energy 'stable', which SOFA implements", got="another one", fix="change the energy",
        )
    constants = [(material.mu, material.lam) for material in scene.materials]  # type: ignore[attr-defined]
    _, poses = plan(mesh, config, scene.probe)
    with locked(out):
        return export_sofa_scene(
            out, mesh, scene.probe, {
                (p.position_index, p.rotation_deg): probe_path(p.position, p.rotation_deg, config.protocol)
                for p in poses
            },
            settings=SofaSettings(
                mu=tuple(mu for mu, _ in constants), lam=tuple(lam for _, lam in constants), gap=config.contact.gap,
                alarm=config.contact.alarm, friction=config.contact.friction,
            ),
        )


@run_scope()
def import_sofa_recordings(
    folder: Path | str, mesh: TissueMesh, constants: SofaConstants, *, positions: Path | str, out: Path | str,
) -> SimulationStore:
    """Turn a folder of SOFA recordings into a store that training and evaluation read like our own.

    Args:
        folder: recordings ``pose_PPP_RRR.npz``.
        mesh: the mesh that they were made on.
        constants: tissue and contact that they were made with.
        positions: file of the listed probe positions.
        out: run directory.

    Raises:
        InputError: a recording that does not fit the mesh or the positions, constants that are not known, or `out`
            holds another run.
    """
    out, listed = Path(out), read_positions(positions)
    record = constants.record(mesh.tissue_names)
    start_run(
        out, "import sofa", {"source": str(folder), **asdict(constants)},
        inputs={"positions": positions, "recordings": folder}, input_hashes={"mesh": mesh.hash()},
    )
    if is_finished(out):
        return SimulationStore.open(out / STORE, mesh=mesh)
    simulations = {(s.position_index, s.rotation_deg): s for s in import_sofa(folder, mesh)}
    highest = max(index for index, _ in simulations)
    if highest >= len(listed):
        raise InputError(
            str(positions), expected=f"the {highest + 1} or more positions of the recordings", got=f"{len(listed)}",
            fix="give the list that the recordings were made with",
        )
    poses = {
        key: Pose(key[0], tuple(float(x) for x in listed[key[0]]), key[1])  # type: ignore[arg-type]
        for key in sorted(simulations)
    }
    store = SimulationStore.create(
        out / STORE, mesh, protocol=SOFA_REPLAY, positions=np.asarray(listed), poses=tuple(poses.values()),
        scene=record,
    )
    for key, pose in poses.items():
        store.save(pose, simulations[key])
    finish_run(out, summarise(store, cells=False).totals())
    return store
