"""The verbs."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mixpinn.base.config import build_config, parse_overrides, read_config_file
from mixpinn.base.errors import InputError
from mixpinn.base.progress import console

if TYPE_CHECKING:
    from mixpinn.pipeline import SimulationConfig
    from mixpinn.records import TissueMesh

app = typer.Typer(
    name="mixpinn", no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False,
    help="From CT label maps to a trained model of how soft tissue and rigid bodies move.",
)
export_app = typer.Typer(help="Write scenes for other simulators.", no_args_is_help=True)
import_app = typer.Typer(help="Read recordings of other simulators.", no_args_is_help=True)
app.add_typer(export_app, name="export")
app.add_typer(import_app, name="import")

Protocol = Annotated[str | None, typer.Option(help="paper, anatomy, small, tiny or sofa-replay.")]
ProbeFile = Annotated[Path | None, typer.Option(help="Probe surface (.stl), tip at the origin, pointing to −y.")]
Positions = Annotated[Path | None, typer.Option(help="File with one probe position a line.")]
PaperConstants = Annotated[bool, typer.Option(help="Tissue constants of the paper's fields.")]
MeshSource = Annotated[Path, typer.Argument(help="Folder that 'mixpinn mesh' wrote, or its mesh.vtu.")]
Out = Annotated[Path, typer.Option("--out", "-o", help="Run directory; an unfinished run in it goes on.")]
Set = Annotated[
    list[str] | None, typer.Option("--set", help="Override a setting, for example train.max_epochs=20; repeatable."),
]
Config = Annotated[Path | None, typer.Option("--config", "-c", help="Settings as TOML or JSON.")]
SplitFile = Annotated[Path | None, typer.Option("--split", help="Split of the positions as JSON, or every-fifth.")]
HoldOut = Annotated[
    str | None, typer.Option(help="Hold-out: rotation-45, rotation-135, deep, lateral, caudal or noise."),
]
Threads = Annotated[int | None, typer.Option(help="CPU threads; every core by default.")]


def _layers(config: Path | None, overrides: list[str] | None, **options: Any) -> list[dict[str, Any]]:
    """Settings by file, then by option, then by --set."""
    return [
        read_config_file(config) if config else {},
        {key: value for key, value in options.items() if value is not None},
        parse_overrides(overrides or []),
    ]


def _simulations(folder: Path) -> Path:
    """The store inside the run directory of `simulate`, or the store itself."""
    for candidate in (folder / "store", folder):
        if (candidate / "store.json").exists():
            return candidate
    raise InputError(
        str(folder), expected="simulations", got="no store.json", fix="give the folder that 'mixpinn simulate' wrote",
    )


def _mesh(source: Path) -> "TissueMesh":
    """The mesh inside the run directory of `mesh`, or the file itself."""
    from mixpinn.records import TissueMesh

    return TissueMesh.load(source if source.suffix == ".vtu" else source / "mesh.vtu")


def _simulation(
    config: Path | None, overrides: list[str] | None, *, protocol: str | None, probe: Path | None,
    positions: Path | None, paper_constants: bool, workers: int | None = None,
) -> "SimulationConfig":
    """Settings of the simulation from file and options."""
    from mixpinn.dataset import PROTOCOLS
    from mixpinn.pipeline import PAPER_TISSUE_CONFIG, SimulationConfig

    if protocol is not None and protocol not in PROTOCOLS:
        raise InputError(
            f"--protocol {protocol}", expected="one of " + ", ".join(PROTOCOLS), got=protocol, fix="choose one of them",
        )
    return build_config(SimulationConfig, *_layers(
        config, overrides, protocol=protocol and asdict(PROTOCOLS[protocol]), probe=probe and str(probe),
        positions=positions and str(positions), workers=workers,
        tissue=asdict(PAPER_TISSUE_CONFIG) if paper_constants else None,
    ))


def _made_with(store: Path, paper_constants: bool) -> "SimulationConfig":
    """How the simulations of a store were made, which the elastic prior needs; recordings do not tell the tissue."""
    from mixpinn.base.files import read_json
    from mixpinn.pipeline import PAPER_TISSUE_CONFIG, SimulationConfig

    record = store.parent / "run.json"
    made = read_json(record) if record.exists() else {}
    return build_config(
        SimulationConfig, made["config"] if made.get("stage") == "simulate" else {},
        {"tissue": asdict(PAPER_TISSUE_CONFIG)} if paper_constants else {},
    )


@app.command()
def anatomy(
    source: Annotated[str, typer.Argument(help="Folder of NIfTIs, one multi-label NIfTI, or 'phantom'.")],
    out: Out,
    names: Annotated[Path | None, typer.Option(help="JSON {number: name} of a multi-label image.")] = None,
    body: Annotated[str | None, typer.Option(help="Name or file of the body.")] = None,
    rigid: Annotated[list[str] | None, typer.Option(help="A rigid structure; repeatable. Lumbar vertebrae.")] = None,
    soft: Annotated[list[str] | None, typer.Option(help="A further soft tissue; repeatable.")] = None,
    repair: Annotated[bool, typer.Option(help="Repair what the label check finds.")] = False,
    seed: Annotated[int | None, typer.Option(help="Vary the phantom.")] = None,
    config: Config = None,
    overrides: Set = None,
) -> None:
    """Label maps → one checked label map in the world frame."""
    from mixpinn.anatomy import AnatomyConfig, make_anatomy
    from mixpinn.pipeline import findings_table

    kind = "phantom" if source == "phantom" else "folder" if Path(source).is_dir() else "multilabel"
    settings = build_config(AnatomyConfig, *_layers(
        config, overrides, source=kind, path=None if kind == "phantom" else source, names=names and str(names),
        body=body, rigid=rigid and tuple(rigid), soft=soft and tuple(soft), repair=repair or None, seed=seed,
    ))
    result = make_anatomy(settings, out=out)
    label_map = result.label_map
    console.print(f"{', '.join(label_map.names)}: {'×'.join(map(str, label_map.labels.shape))} voxels in {out}")
    if result.findings:
        console.print(findings_table(result.findings).rich())


@app.command()
def mesh(
    source: Annotated[Path, typer.Argument(help="Folder that 'mixpinn anatomy' wrote, or a ready .vtu.")],
    out: Out,
    size: Annotated[float | None, typer.Option(help="1 is the paper's resolution, larger is coarser.")] = None,
    mesher: Annotated[str | None, typer.Option(help="cgal, tetwild or auto.")] = None,
    fixed: Annotated[Path | None, typer.Option(help="File of fixed node indices for a ready .vtu.")] = None,
    config: Config = None,
    overrides: Set = None,
) -> None:
    """Label map → labelled tetrahedral mesh with its statistics, quality and fidelity."""
    from mixpinn.mesh import MeshConfig, make_mesh
    from mixpinn.pipeline import fidelity_table, quality_table
    from mixpinn.records import LabelMap

    settings = build_config(MeshConfig, *_layers(
        config, overrides, size=size, mesher=mesher, fixed=fixed and str(fixed),
    ))
    given: LabelMap | Path = source if source.suffix == ".vtu" else LabelMap.load(source / "labels.nii.gz")
    result = make_mesh(given, settings, out=out)
    console.print(result.statistics.table())
    console.print(quality_table(result.quality).rich())
    if result.fidelity is not None:
        console.print(fidelity_table(result.fidelity).rich())


@app.command()
def simulate(
    source: MeshSource,
    out: Out,
    protocol: Protocol = None,
    probe: ProbeFile = None,
    positions: Positions = None,
    paper_constants: PaperConstants = False,
    workers: Annotated[int | None, typer.Option(help="Processes; every core by default.")] = None,
    scheduler: Annotated[str | None, typer.Option(help="Address of a Dask scheduler to use instead.")] = None,
    config: Config = None,
    overrides: Set = None,
) -> None:
    """Press the probe over the grid of poses; finished poses are kept if the command is stopped."""
    from mixpinn.pipeline import make_simulations

    settings = _simulation(
        config, overrides, protocol=protocol, probe=probe, positions=positions, paper_constants=paper_constants,
        workers=workers,
    )
    _, summary = make_simulations(_mesh(source), settings, out=out, scheduler=scheduler)
    if summary.failed or summary.failed_steps:
        console.print(f"[yellow]{summary.failed} poses and {summary.failed_steps} steps failed[/]; see {out}/poses.png")


@app.command()
def dataset(
    source: Annotated[Path, typer.Argument(help="Folder that 'mixpinn simulate' wrote.")],
    split_file: SplitFile = None,
) -> None:
    """Positions, poses and samples of each part of the split."""
    from mixpinn.dataset import SimulationStore, dataset_table
    from mixpinn.evaluation import dataset_counts_table
    from mixpinn.pipeline import SplitConfig, load_samples

    store = SimulationStore.open(_simulations(source))
    table, split = load_samples(store, SplitConfig(file=str(split_file) if split_file else None))
    console.print(dataset_counts_table(dataset_table(table, split)).rich())


@app.command()
def train(
    source: Annotated[Path, typer.Argument(help="Folder that 'mixpinn simulate' wrote.")],
    out: Out,
    model: Annotated[str, typer.Option(help="hybrid, mixpinn, simple-gat, physgnn or row-1 … row-13.")] = "mixpinn",
    width: Annotated[str | None, typer.Option(help="tiny, desk, authors or paper.")] = None,
    epochs: Annotated[int | None, typer.Option(help="Largest number of epochs.")] = None,
    scaling: Annotated[str | None, typer.Option(help="none or standard.")] = None,
    devices: Annotated[int, typer.Option(help="Processes, each with a device of its own.")] = 1,
    split_file: SplitFile = None,
    hold_out: HoldOut = None,
    paper_constants: PaperConstants = False,
    config: Config = None,
    overrides: Set = None,
) -> None:
    """Train one model; an interrupted run goes on to the same loss curve."""
    from mixpinn.dataset import SimulationStore
    from mixpinn.pipeline import (
        HYBRID,
        HybridStageConfig,
        ModelsConfig,
        SplitConfig,
        load_samples,
        make_hybrid,
        train_model,
    )

    settings = build_config(
        ModelsConfig, {"names": [model]}, *_layers(config, None, width=width, scaling=scaling),
        {"train": {"max_epochs": epochs}} if epochs else {}, parse_overrides(overrides or []),
    )
    store = SimulationStore.open(_simulations(source))
    table, split = load_samples(store, SplitConfig(file=str(split_file) if split_file else None))
    if model == HYBRID:
        hybrid = make_hybrid(
            store, table, split,
            HybridStageConfig.of_simulation(_made_with(store.folder, paper_constants), settings.hybrid), out=out,
            held_out=hold_out,
        )
        samples = hybrid.about["training_samples"]
        console.print(f"{len(hybrid.newton.modes)} modes from {samples} samples; model in {out}")
        return
    result = train_model(model, settings, table, split, store, out=out, devices=devices, held_out=hold_out)
    console.print(
        f"{len(result.history)} epochs, best {result.best_epoch} with {result.best_validation_loss:.4f} mm on the "
        f"validation positions ({result.stopped_by}); model in {out}"
    )


@app.command()
def evaluate(
    source: Annotated[Path, typer.Argument(help="Folder that 'mixpinn simulate' wrote.")],
    models: Annotated[list[Path], typer.Argument(help="Folders that 'mixpinn train' wrote.")],
    out: Out,
    pictures: Annotated[bool, typer.Option(help="Render the deformed mesh.")] = True,
    paper: Annotated[bool, typer.Option(help="Show the paper's rows too.")] = False,
    split_file: SplitFile = None,
    hold_out: HoldOut = None,
    paper_constants: PaperConstants = False,
    threads: Threads = None,
) -> None:
    """Metrics on the test positions, pictures and the HTML report."""
    from mixpinn.dataset import SimulationStore
    from mixpinn.pipeline import (
        Background,
        EvaluationConfig,
        SplitConfig,
        evaluate_models,
        load_samples,
    )

    store = SimulationStore.open(_simulations(source))
    simulation = _made_with(store.folder, paper_constants)
    table, split = load_samples(store, SplitConfig(file=str(split_file) if split_file else None))
    _, report = evaluate_models(
        models, store, table, split, EvaluationConfig(pictures=pictures, with_paper=paper), out=out,
        background=Background(simulation=simulation), threads=threads, held_out=hold_out,
    )
    console.print(f"Report: {report}")


@app.command()
def ablate(
    source: Annotated[str, typer.Argument(help="Label maps, 'phantom', a mesh, or the folder of 'mixpinn simulate'.")],
    out: Out,
    protocol: Annotated[str, typer.Option(help="desk or paper.")] = "desk",
    rows: Annotated[list[str] | None, typer.Option("--row", help="Only this row; repeatable. All fourteen.")] = None,
    width: Annotated[int | None, typer.Option(help="Channels a head.")] = None,
    probe: ProbeFile = None,
    positions: Positions = None,
    split_file: SplitFile = None,
    workers: Annotated[int, typer.Option(help="Processes; every core by default.")] = 0,
    threads: Annotated[int, typer.Option(help="CPU threads of each process.")] = 1,
    scheduler: Annotated[str | None, typer.Option(help="Address of a Dask scheduler to use instead.")] = None,
    devices: Annotated[int, typer.Option(help="Processes of each training, each with a device of its own.")] = 1,
    tables_only: Annotated[bool, typer.Option("--tables-only", help="Only write tables of what is finished.")] = False,
    config: Config = None,
    overrides: Set = None,
) -> None:
    """The paper's experiments: every row trained and tested, with hold-outs; goes on where it was stopped."""
    from mixpinn.pipeline import ABLATION_RUNS, AblationConfig, run_ablation

    if protocol not in ABLATION_RUNS:
        raise InputError(
            f"--protocol {protocol}", expected="one of " + ", ".join(ABLATION_RUNS), got=protocol,
            fix="choose one of them",
        )
    settings = build_config(AblationConfig, asdict(ABLATION_RUNS[protocol]), *_layers(
        config, overrides, rows=rows and tuple(rows), hidden=width,
        split={"file": str(split_file)} if split_file else None,
        simulation={
            name: str(path) for name, path in (("probe", probe), ("positions", positions)) if path
        } or None,
    ))
    run_ablation(
        source, settings, out=out, workers=workers, threads=threads, scheduler=scheduler, devices=devices,
        tables_only=tables_only,
    )


@app.command()
def profile(
    meshes: Annotated[list[Path], typer.Argument(help="Folders that 'mixpinn mesh' wrote, or .vtu files, by name.")],
    out: Out,
    models: Annotated[list[str] | None, typer.Option("--model", help="Only this model; repeatable.")] = None,
    width: Annotated[int | None, typer.Option(help="Channels a head.")] = None,
    threads: Annotated[int | None, typer.Option(help="CPU threads of every method; 1 by default.")] = None,
    repeats: Annotated[int | None, typer.Option(help="Predictions that are timed.")] = None,
    probe: ProbeFile = None,
    config: Config = None,
    overrides: Set = None,
) -> None:
    """Run time of solver, prior and networks on each mesh: time, memory, growth; goes on where it was stopped."""
    from mixpinn.pipeline import ProfileConfig, run_profile

    settings = build_config(ProfileConfig, *_layers(
        config, overrides, methods=models and tuple(models), hidden=width, threads=threads, repeats=repeats,
        simulation={"probe": str(probe)} if probe else None,
    ))
    names = [path.stem if path.suffix == ".vtu" else path.name for path in meshes]
    if len(set(names)) < len(names):
        raise InputError(
            "meshes", expected="folders or files of different names", got=", ".join(names), fix="rename one of them",
        )
    run_profile(dict(zip(names, map(_mesh, meshes), strict=True)), settings, out=out)


@app.command()
def predict(
    model: Annotated[Path, typer.Argument(help="Folder that 'mixpinn train' wrote.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Deformed mesh: .vtu, .stl or .ply.")],
    contacts: Annotated[Path | None, typer.Option(help="Contact nodes and displacements: .csv, .json or .npz.")] = None,
    simulations: Annotated[Path | None, typer.Option(help="Take a sample of these simulations instead.")] = None,
    tip: Annotated[str | None, typer.Option(help="Press the probe's tip to 'x,y,z' [mm] (hybrid model).")] = None,
    position: Annotated[int, typer.Option(help="Index of the sample's probe position.")] = 0,
    rotation: Annotated[float, typer.Option(help="The probe's rotation in degrees.")] = 0.0,
    depth: Annotated[float | None, typer.Option(help="Its depth in mm; the deepest by default.")] = None,
    threads: Threads = None,
) -> None:
    """Contact displacement, or the probe's pose, → deformed mesh, for ParaView and 3D Slicer."""
    from mixpinn.serving import ProbeAddress, SampleAddress, predict_stage

    if sum(source is not None for source in (contacts, simulations, tip)) != 1:
        raise InputError(
            "predict", expected="one of --contacts, --simulations and --tip", got="none or several",
            fix="give one of them",
        )
    source: Path | SampleAddress | ProbeAddress
    if contacts is not None:
        source = contacts
    elif tip is not None:
        source = ProbeAddress.read(tip, rotation)
    else:
        assert simulations is not None
        source = SampleAddress(_simulations(simulations), position, rotation, depth)
    predict_stage(model, source, out, threads=threads)
    console.print(f"Deformed mesh: {out}")


@app.command()
def run(
    config: Annotated[Path, typer.Argument(help="Settings of all stages as TOML or JSON.")],
    out: Out,
    overrides: Set = None,
    threads: Threads = None,
) -> None:
    """The whole pipeline, from label maps to report; goes on where it was stopped."""
    from mixpinn.pipeline import RunConfig, run_pipeline

    run_pipeline(build_config(RunConfig, *_layers(config, overrides)), out=out, threads=threads)


@app.command()
def demo(out: Out = Path("runs/demo"), overrides: Set = None, threads: Threads = None) -> None:
    """The whole pipeline on the built-in phantom."""
    from mixpinn.pipeline import DEMO, RunConfig, run_pipeline

    run_pipeline(build_config(RunConfig, asdict(DEMO), *_layers(None, overrides)), out=out, threads=threads)


@app.command()
def onboard(
    source: Annotated[str, typer.Argument(help="Folder of NIfTIs, one multi-label NIfTI, or 'phantom'.")],
    out: Out,
    poses: Annotated[int | None, typer.Option(help="Poses to simulate and learn from; 0 stops at the prior.")] = None,
    probe: ProbeFile = None,
    size: Annotated[float | None, typer.Option(help="Mesh size: 1 is the paper's, larger is coarser.")] = None,
    workers: Annotated[int | None, typer.Option(help="Processes; every core by default.")] = None,
    pictures: Annotated[bool, typer.Option(help="Render the deformed mesh.")] = True,
    config: Config = None,
    overrides: Set = None,
) -> None:
    """Label maps → a predictor bundle, usable after the prior and better after each round of poses; with a report."""
    from mixpinn.pipeline import OnboardingConfig, onboard

    kind = "phantom" if source == "phantom" else "folder" if Path(source).is_dir() else "multilabel"
    anatomy: dict[str, Any] = {"source": kind, "path": None if kind == "phantom" else source}
    simulation = {"probe": probe and str(probe), "workers": workers}
    settings = build_config(OnboardingConfig, *_layers(
        config, overrides, poses=poses, pictures=None if pictures else False,
        anatomy={**anatomy, "repair": kind != "phantom"}, mesh={"size": size} if size else None,
        simulation={key: value for key, value in simulation.items() if value is not None} or None,
    ))
    console.print(f"Predictor: {onboard(settings, out=out)}")


@export_app.command("sofa")
def export_sofa(
    source: MeshSource,
    out: Out,
    protocol: Protocol = None,
    probe: ProbeFile = None,
    positions: Positions = None,
    paper_constants: PaperConstants = False,
    config: Config = None,
    overrides: Set = None,
) -> None:
    """The same set-up as a documented SofaPython3 scene with a recorder."""
    from mixpinn.pipeline import export_sofa as write

    settings = _simulation(
        config, overrides, protocol=protocol, probe=probe, positions=positions, paper_constants=paper_constants,
    )
    console.print(f"Scene: {write(_mesh(source), settings, out=out)}")


@import_app.command("sofa")
def import_sofa(
    recordings: Annotated[Path, typer.Argument(help="Folder of recordings pose_PPP_RRR.npz.")],
    mesh_source: Annotated[Path, typer.Option("--mesh", help="Mesh that they were made on: folder or .vtu.")],
    positions: Annotated[Path, typer.Option(help="File with one listed probe position a line.")],
    out: Out,
) -> None:
    """SOFA recordings → simulations that 'mixpinn train' and 'evaluate' read."""
    from mixpinn.pipeline import import_sofa_recordings

    store = import_sofa_recordings(recordings, _mesh(mesh_source), positions=positions, out=out)
    console.print(f"{len(store.poses)} poses in {out}")
