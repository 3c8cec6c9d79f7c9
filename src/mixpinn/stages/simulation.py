"""The simulation stage: a mesh and a protocol in, a store of simulated poses out."""

import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Literal

from mixpinn.anatomy.mixture import mixed_parts
from mixpinn.base.arrays import FloatArray
from mixpinn.base.config import build_config
from mixpinn.base.errors import InputError, SolveError
from mixpinn.base.progress import console
from mixpinn.base.rundir import finish_run, run_scope, start_run
from mixpinn.base.sensible import positive, require_settings
from mixpinn.dataset import (
    ANATOMY,
    GenerationSummary,
    Pose,
    Protocol,
    SimulationStore,
    generate,
    grid_positions,
    left_at_ends,
    plan_poses,
    read_positions,
    save_pose_map,
)
from mixpinn.dataset.local_pool import STEP_TIMEOUT
from mixpinn.fem import (
    ContactConfig,
    LinearElastic,
    LocalRefinement,
    Material,
    Scene,
    SolverConfig,
    StableNeoHookean,
    StableNeoHookeanLog,
    scene_hash,
    scene_record,
)
from mixpinn.fem.material.mixed import mean_material
from mixpinn.fem.material.skin_presets import MEMBRANES, SkinPreset, preset_of
from mixpinn.fem.material.tissue_presets import TissuePreset, preset_modulus
from mixpinn.geometry.probe_shapes import linear_probe
from mixpinn.physics.restraints import JOINTS
from mixpinn.records import Probe, TissueMesh
from mixpinn.records.probe import check_probe
from mixpinn.records.probe_valleys import valley_warning
from mixpinn.stages.restraints import (
    AS_MESHED,
    JointChoice,
    SupportConfig,
    joints_between,
    settings_of_restraints,
    settled_joints,
    supported,
)

STORE = "store"
_PROBE = "probe: shape: "
"""How a doubt about the probe begins (`mixpinn.records.doubts`)."""
_STIFFEST = 1e10
"""Modulus of no matter [kPa]: diamond has a tenth of it."""
Energy = Literal["stable", "stable-log", "linear"]


_LAWS: dict[Energy, type[StableNeoHookean | StableNeoHookeanLog | LinearElastic]] = {
    "stable": StableNeoHookean, "stable-log": StableNeoHookeanLog, "linear": LinearElastic,
}


@dataclass(frozen=True)
class TissueConfig:
    """A soft tissue.

    Attributes:
        young: Young's modulus E [kPa].
        poisson: Poisson's ratio ν.
        mu, lam: Lamé constants [kPa]; given both, they are used instead of E and ν.
        energy: Stable Neo-Hookean without (``stable``) or with (``stable-log``) the log term, or ``linear``.
    """

    young: float = 25.4
    poisson: float = 0.45
    mu: float | None = None
    lam: float | None = None
    energy: Energy = "stable"

    def __post_init__(self) -> None:
        for name in ("young", "mu", "lam"):
            if abs(getattr(self, name) or 0.0) > _STIFFEST:
                raise InputError(
                    f"tissue.{name}", expected=f"at most {_STIFFEST:g} kPa", got=f"{getattr(self, name):g}",
                    fix="give it in kPa",
                )
        self.material()  # constants of no stable material are refused when they are given

    def material(self) -> Material:
        """The constitutive law, in N/mm².

        Raises:
            InputError: constants of no stable material.
        """
        law = _LAWS[self.energy]
        if (self.mu is None) != (self.lam is None):
            raise InputError("tissue", expected="both mu and lam, or neither", got="one of them", fix="give the other")
        if self.mu is not None and self.lam is not None:
            return law(mu=self.mu * 1e-3, lam=self.lam * 1e-3)
        return law.from_young(self.young * 1e-3, self.poisson)

    @staticmethod
    def of_material(material: Material) -> "TissueConfig":
        """The settings that give a built-in material.

        Raises:
            InputError: a class of the user's own.
        """
        for energy, law in _LAWS.items():
            if isinstance(material, law):
                return TissueConfig(mu=material.mu * 1e3, lam=material.lam * 1e3, energy=energy)
        raise InputError(
            "tissue", expected="a built-in material", got=type(material).__name__, fix="simulate with one of them",
        )


PAPER_TISSUE_CONFIG = TissueConfig(mu=8.758621, lam=84.666667)
"""The constants with which the paper's fields were made."""


@dataclass(frozen=True)
class SimulationConfig:
    """What is simulated.

    Attributes:
        tissue: of all soft tissue that `tissues` does not name.
        tissues: by name of the mesh's tissue.
        probe: surface file (.stl, .ply, .vtp, .obj) with its tip at the origin, pointing to −y; None for the built-in
            linear probe.
        protocol: rotations, depths and path.
        positions: file with one probe position ``x y z`` [mm] a line; None for a grid over the rigid parts.
        contact: gap, friction and stiffness.
        solver: tolerance and limits.
        workers: processes; 0 takes every core.
        timeout: a worker that finishes no step for so long is ended, and its pose tried once more [s].
        moduli: of tissues that are known by name and not in `tissues`: ``compression`` or ``elastography``
            (`mixpinn.fem.material.tissue_presets`), or ``none`` for those of `tissue`.
        joints: between vertebrae that follow each other: ``none``, ``in-vitro`` or ``in-vivo-prone``. ``auto`` is
            in-vivo-prone where label maps were meshed (not where discs are among the tissues), else none.
        joint_frames: file of joint frames instead of those that the anatomy gives.
        support: what the body rests on.
        membrane: the skin besides the tissue under it: ``none``, ``tension`` or ``elastic``
            (`mixpinn.fem.material.skin_presets`).
        refinement: of the cells under the probe, for each pose anew (`mixpinn.fem.local_refinement`); None solves all
            poses on the mesh as it is.
    """

    tissue: TissueConfig = field(default_factory=TissueConfig)
    tissues: dict[str, TissueConfig] = field(default_factory=dict)
    probe: str | None = None
    protocol: Protocol = ANATOMY
    positions: str | None = None
    contact: ContactConfig = field(default_factory=ContactConfig)
    solver: SolverConfig = field(default_factory=lambda: SolverConfig(threads=1))
    workers: int = 0
    timeout: float = STEP_TIMEOUT
    moduli: TissuePreset = TissuePreset.COMPRESSION
    joints: JointChoice = "auto"
    joint_frames: str | None = None
    support: SupportConfig = AS_MESHED
    membrane: SkinPreset = SkinPreset.NONE
    refinement: LocalRefinement | None = None

    def __post_init__(self) -> None:
        require_settings(self, "simulation", positive(self, "timeout"))
        if self.workers < 0:
            raise InputError(
                "workers", expected="0 for every core, or more", got=str(self.workers), fix="correct the setting",
            )


def _material(name: str, config: SimulationConfig) -> Material:
    parts = mixed_parts(name)
    if len(parts) > 1 and name not in config.tissues:
        return mean_material([(share, _material(part, config)) for part, share in parts])
    known = preset_modulus(name, config.moduli) if name not in config.tissues else None
    return config.tissues.get(name, config.tissue).material() if known is None else known.material()


def make_scene(mesh: TissueMesh, config: SimulationConfig) -> Scene:
    """The scene of `config` on `mesh`; where the support says so, other nodes of its mesh are fixed.

    What is odd about the probe is said, and stays among the doubts of the scene's mesh.

    Raises:
        InputError: a tissue or a part that the mesh does not have, no frames for joints, or an unreadable probe.
    """
    parts = {part for name in mesh.tissue_names for part, _ in mixed_parts(name)}
    unknown = sorted(set(config.tissues) - set(mesh.tissue_names) - parts)
    if unknown:
        raise InputError(
            f"tissue {unknown[0]!r}", expected="one of " + ", ".join(mesh.tissue_names), got="another name",
            fix="name a tissue of the mesh",
        )
    materials = tuple(_material(name, config) for name in mesh.tissue_names)
    probe = linear_probe() if config.probe is None else Probe.load(config.probe)
    mesh = _with_doubts(mesh, check_probe(probe))
    mesh, foundations = supported(mesh, config.support)
    joints = joints_between(mesh, config.joints, frames=config.joint_frames)
    return Scene(
        mesh, probe, materials, config.contact, config.solver, joints=joints, foundations=foundations,
        membrane=MEMBRANES[config.membrane], refinement=config.refinement,
    )


def _with_doubts(mesh: TissueMesh, noticed: Sequence[str]) -> TissueMesh:
    """`mesh` with what was noticed about its probe, which is said, too; what another probe left there is gone."""
    for line in noticed:
        console.print(f"[yellow]warning[/]: {line}", soft_wrap=True)
    kept = tuple(doubt for doubt in mesh.doubts if not doubt.startswith(_PROBE))
    doubts = (*kept, *(_PROBE + line for line in noticed))
    return mesh if doubts == mesh.doubts else replace(mesh, doubts=doubts)


def for_patients(config: SimulationConfig, soft_names: Sequence[str]) -> SimulationConfig:
    """`config` with what `auto` means for the meshed label maps of a patient, whose soft tissues have these names."""
    return replace(config, joints=settled_joints(config.joints, soft_names))


def settings_of(store: SimulationStore) -> SimulationConfig:
    """Settings that simulate another protocol with the tissue and the contact of `store`.

    Raises:
        InputError: they are not recorded, or joints or foundations are none that settings can name.
    """
    mesh, solver = store.mesh(), dict(store.scene.get("solver", {}))
    names = mesh.tissue_names
    solver.pop("kind", None)
    choice, support = settings_of_restraints(mesh, store.restraints())
    return SimulationConfig(
        tissues={
            name: TissueConfig.of_material(material) for name, material in zip(names, store.materials(), strict=True)
        },
        protocol=store.protocol, contact=store.contact(), joints=choice, support=support,
        membrane=preset_of(store.restraints().membrane), refinement=store.refinement(),
        solver=build_config(SolverConfig, {"threads": 1}, solver),
    )


def plan(mesh: TissueMesh, config: SimulationConfig, probe: Probe) -> tuple[FloatArray, tuple[Pose, ...]]:
    """Listed probe positions [mm], shape (p, 3), and the poses of the protocol at them.

    Raises:
        InputError: unreadable positions, or no skin in the probe's way.
    """
    if config.positions is None:
        positions = grid_positions(mesh, config.protocol, probe=probe)
        if line := bones_left_out(mesh, config, probe):
            console.print(line, soft_wrap=True)
    else:
        positions = read_positions(config.positions)
    return positions, plan_poses(positions, config.protocol, mesh=mesh, probe=probe, gap=config.contact.gap)


def bones_left_out(mesh: TissueMesh, config: SimulationConfig, probe: Probe) -> str:
    """A line about bones that the grid of positions leaves out, since the probe would hang over an end of the scan."""
    left = left_at_ends(mesh, config.protocol, probe) if config.positions is None else (0.0, 0.0)
    named = zip(("upper", "lower"), left, strict=True)
    ends = " and ".join(f"{length:.0f} mm at the {end} end" for end, length in named if length > 0.5)
    return ends and (
        f"{ends} of the bones get no poses: the probe would hang over the end of the scan there, and answers are "
        "expected to be less certain"
    )


def failed_for_valleys(store: SimulationStore) -> str:
    """What may be why steps of `store` failed, where its probe has valleys; empty where it has none."""
    probe = store.probe()
    return "" if probe is None else valley_warning(probe.points, probe.triangles)


def settings_of_scene(scene: Scene, protocol: Protocol) -> SimulationConfig:
    """The settings with which `make_simulations` simulates `scene`; the probe is the scene's own.

    Materials of the user's own class have no settings; the record of the scene names them.
    """
    return SimulationConfig(
        tissues={
            name: TissueConfig.of_material(material)
            for name, material in zip(scene.mesh.tissue_names, scene.materials, strict=True)
            if isinstance(material, tuple(_LAWS.values()))
        },
        protocol=protocol, contact=scene.contact, solver=replace(scene.solver, threads=scene.solver.threads or 1),
        refinement=scene.refinement,
    )


def begin_simulations(
    mesh: TissueMesh, config: SimulationConfig, *, out: Path, scene: Scene | None = None,
) -> tuple[Scene, SimulationStore]:
    """Open the run directory `out`: the scene, and the store that its poses go to.

    Args:
        mesh: the mesh.
        config: what is simulated.
        out: run directory.
        scene: the scene of these settings, with a probe that lies in no file; None makes it.

    Raises:
        InputError: bad settings, or `out` holds another run.
    """
    own_probe = {} if scene is None else {"probe": scene.probe.hash()}
    scene = scene or make_scene(mesh, config)
    mesh, record = scene.mesh, scene_record(scene)
    own_joints = {} if not scene.joints else {"joints": scene_hash({JOINTS: record[JOINTS]}, mesh.hash())}
    inputs = {name: path for name, path in (("probe", config.probe), ("positions", config.positions)) if path}
    settings = asdict(config)
    for later in ("workers", "timeout"):  # decide when, not what
        del settings[later]
    usual = {
        "moduli": "compression", "joints": "auto", "joint_frames": None, "support": asdict(AS_MESHED),
        "membrane": "none", "refinement": None,
    }
    for name, value in usual.items():
        if settings[name] == value:  # as runs have them that were begun before there was such a setting
            del settings[name]

    def start() -> None:
        hashes = {"mesh": mesh.hash(), **own_probe, **own_joints}
        start_run(out, "simulate", settings, inputs=inputs, input_hashes=hashes)

    if (out / STORE / "store.json").exists():
        start()
        store = SimulationStore.open(out / STORE, mesh=mesh)
        if store.scene_hash != scene.hash() and not store.is_complete:
            raise InputError(
                str(out), expected="a run of the same physics", fix="choose another folder, or delete this one",
                got="one that was begun otherwise, perhaps by an earlier version, and is not complete",
            )
    else:
        # Planned first, so that bad positions leave nothing behind.
        positions, poses = plan(mesh, config, scene.probe)
        start()
        store = SimulationStore.create(
            out / STORE, mesh, protocol=config.protocol, positions=positions, poses=poses, scene=record,
            probe=scene.probe,
        )
    return scene, store


@run_scope()
def make_simulations(
    mesh: TissueMesh, config: SimulationConfig, *, out: Path | str, scheduler: str | None = None,
    scene: Scene | None = None,
) -> tuple[SimulationStore, GenerationSummary]:
    """Simulate every pose of the protocol into the run directory `out`; finished poses are kept.

    Args:
        mesh: the mesh.
        config: what is simulated.
        out: run directory: ``store/``, ``summary.json``, ``poses.png``.
        scheduler: address of a Dask scheduler whose workers are used instead of this machine's cores.
        scene: the scene of these settings, with a probe that lies in no file; None makes it.

    Raises:
        InputError: bad settings, a probe that starts inside the body, or `out` holds another run.
    """
    out = Path(out)
    scene, store = begin_simulations(mesh, config, out=out, scene=scene)
    summary = generate(
        scene, store.poses, store, workers=config.workers or os.cpu_count() or 1, threads=scene.solver.threads or 1,
        scheduler=scheduler, timeout=config.timeout,
    )
    summary.save(out / "summary.json")
    if not summary.done:
        raise InputError(
            str(out), expected="at least one pose that can be simulated",
            got=f"{summary.failed} failures, the first: {next(iter(summary.reasons), 'unknown')}",
            fix="correct the settings and simulate into another folder",
        )
    if summary.steps and summary.failed_steps >= summary.steps:
        raise SolveError(
            f"{out}: none of {summary.steps} steps converged; is the mesh held by fixed nodes, in one piece and in mm? "
            "'mixpinn mesh' says what is odd about it"
        )
    save_pose_map(store, out / "poses.png")
    finish_run(out, summary.totals())
    return store, summary
