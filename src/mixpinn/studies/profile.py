"""The run-time table: the solver, the elastic prior and each network, on meshes of several sizes."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from mixpinn.base.errors import InputError
from mixpinn.base.files import write_json, write_text
from mixpinn.base.progress import console, track
from mixpinn.base.rundir import finish_run, run_scope, start_run
from mixpinn.base.validated import load_record, save_record
from mixpinn.dataset import ANATOMY, Protocol, probe_path, table_of
from mixpinn.evaluation import save_figure
from mixpinn.fem import PoseSimulator
from mixpinn.networks import MODELS
from mixpinn.records import SampleTable, TissueMesh
from mixpinn.records.answer import discretisation_of
from mixpinn.reduced.prior import ElasticPrior
from mixpinn.stages.simulation import PAPER_TISSUE_CONFIG, SimulationConfig, make_scene, plan
from mixpinn.studies.profile_measure import PRIOR, TIMEOUT, Timing, measure_model, model_config, timing
from mixpinn.studies.profile_tables import cost_figure, depth_figure, exponent_table, profile_table

METHODS = ("row-1", "row-2", "row-3", "row-5", "row-6", "row-10", "row-11", "physgnn")
"""Networks that differ in their cost: the Rigid Edge Loss changes training only, so that rows 4, 7, 8, 9, 12 and 13
cost what rows 3, 5, 6, 2, 10 and 11 cost."""
_REMAKE = "delete it: it is measured again"


@dataclass(frozen=True)
class ProfileConfig:
    """What is measured.

    Attributes:
        models: networks of the tables.
        hidden: channels a head of the attention layers.
        physgnn_hidden: channels of PhysGNN's convolutions.
        threads: CPU threads of every method.
        repeats: predictions that are timed, over the depths in turn.
        simulation: the scene and the path of the pose that is simulated.
        prior: include the elastic prior.
        timeout: a measurement of a network that takes longer is ended [s].
    """

    models: tuple[str, ...] = METHODS
    hidden: int = 128
    physgnn_hidden: int = 112
    threads: int = 1
    repeats: int = 40
    simulation: SimulationConfig = field(default_factory=lambda: SimulationConfig(
        tissue=PAPER_TISSUE_CONFIG, protocol=replace(ANATOMY, rotations=(0.0,), max_positions=1),
    ))
    prior: bool = True
    timeout: float = TIMEOUT

    def __post_init__(self) -> None:
        for method in self.models:
            if method not in MODELS:
                raise InputError(
                    f"method {method!r}", expected="one of " + ", ".join(MODELS), got=method, fix="choose one of them",
                )
        for name in ("threads", "repeats", "hidden", "physgnn_hidden"):
            if getattr(self, name) < 1:
                raise InputError(name, expected="at least 1", got=str(getattr(self, name)), fix="correct the setting")


@run_scope()
def run_profile(meshes: Mapping[str, TissueMesh], config: ProfileConfig, *, out: Path | str) -> tuple[Timing, ...]:
    """Measure every method on every mesh; what is measured is kept if the command is stopped.

    Args:
        meshes: by name.
        config: what is measured.
        out: run directory: ``timings/``, ``results.json``, ``results.csv``, ``results.md``, ``cost.png``,
            ``depth.png``.

    Raises:
        InputError: no mesh, or `out` holds another run.
        MixpinnError: a measurement failed.
    """
    if not meshes:
        raise InputError("meshes", expected="at least one", got="none", fix="name a mesh")
    out = Path(out)
    settings = asdict(config)
    for group in (settings, settings["simulation"]):
        del group["timeout"]  # decides when
    start_run(out, "profile", settings, input_hashes={name: mesh.hash() for name, mesh in meshes.items()})
    timings: list[Timing] = []
    for name, mesh in meshes.items():
        fem, samples = _solver(name, mesh, config, out)
        timings.append(fem)
        if config.prior:
            timings.append(_kept(out, name, PRIOR, partial(_prior, name, mesh, samples, config)))
        for method in track(config.models, f"predictions on {name}"):
            network = model_config(method, hidden=config.hidden, physgnn_hidden=config.physgnn_hidden)
            timings.append(_kept(out, name, method, partial(
                measure_model, network, samples, (name, mesh), method=method, threads=config.threads,
                repeats=config.repeats, timeout=config.timeout,
            )))
    _report(timings, meshes, config, out)
    finish_run(out, {"timings": len(timings)})
    return tuple(timings)


def _kept(out: Path, mesh: str, method: str, measure: Callable[[], Timing]) -> Timing:
    """The measurement that lies in `out`, or a new one."""
    path = out / "timings" / f"{mesh}-{method}.json"
    if path.exists():
        return load_record(Timing, path, remake=_REMAKE, finite=False)
    found = measure()
    save_record(path, found)
    return found


def _solver(name: str, mesh: TissueMesh, config: ProfileConfig, out: Path) -> tuple[Timing, SampleTable]:
    """Time of a step with contact, and the samples that all networks are timed on."""
    path, folder = out / "timings" / f"{name}-fem.json", out / "samples" / name
    if path.exists() and (folder / "samples.json").exists():
        return load_record(Timing, path, remake=_REMAKE, finite=False), SampleTable.load(folder)
    simulation = replace(config.simulation, solver=replace(config.simulation.solver, threads=config.threads))
    scene = make_scene(mesh, simulation)
    _, poses = plan(mesh, simulation, scene.probe)
    simulator = PoseSimulator(scene)
    protocol: Protocol = simulation.protocol
    # A first short pose compiles the kernels and does not count.
    simulator.run(probe_path(poses[0].position, 0.0, replace(protocol, steps=min(2, protocol.steps))))
    runs = [
        simulator.run(
            probe_path(pose.position, pose.rotation_deg, protocol), position_index=pose.position_index,
            rotation_deg=pose.rotation_deg,
        ) for pose in track(poses, f"solver on {name}")
    ]
    samples = table_of(runs)
    steps = [run.sample_steps() for run in runs]
    seconds = np.concatenate([run.seconds[chosen] for run, chosen in zip(runs, steps, strict=True)])
    found = timing(
        seconds, samples.depth, mesh=(name, mesh), method="fem", device="cpu", threads=config.threads, peak_mb=None,
    )
    samples.save(folder)
    save_record(path, found)
    return found, samples


def _prior(name: str, mesh: TissueMesh, samples: SampleTable, config: ProfileConfig) -> Timing:
    import torch

    nodes = np.unique(samples.contact_nodes)
    scene = make_scene(mesh, config.simulation)
    prior = ElasticPrior.build(scene.mesh, scene.materials, nodes=nodes, restraints=scene.restraints)
    torch.set_num_threads(config.threads)
    seconds = []
    for turn in range(-2, config.repeats):
        contact = samples.contact(turn % len(samples))
        began = time.perf_counter()
        prior.predict(*contact)
        if turn >= 0:
            seconds.append(time.perf_counter() - began)
    depth = samples.depth[np.arange(config.repeats) % len(samples)]
    return timing(
        np.array(seconds), depth, mesh=(name, mesh), method=PRIOR, device="cpu", threads=config.threads, peak_mb=None,
    )


def _report(
    timings: Sequence[Timing], meshes: Mapping[str, TissueMesh], config: ProfileConfig, out: Path,
) -> None:
    rows = [asdict(entry) for entry in timings]
    made_on = {name: discretisation_of(mesh) for name, mesh in meshes.items()}
    tables = [profile_table(rows, made_on), exponent_table(rows)]
    save_figure(cost_figure(rows), out / "cost.png")
    save_figure(depth_figure(rows), out / "depth.png")
    write_json(out / "results.json", {
        "timings": rows, "hidden": config.hidden, "physgnn_hidden": config.physgnn_hidden, "threads": config.threads,
        "exponents": {str(row[0]): row[1] for row in tables[1].rows},
    })
    write_text(out / "results.csv", tables[0].csv())
    write_text(out / "results.md", "\n".join([
        "## Run time\n", *(table.markdown() for table in tables), "![Cost against size](cost.png)\n",
        "![Time against depth](depth.png)\n",
    ]))
    console.print(tables[0].rich())
    console.print(tables[1].rich())
