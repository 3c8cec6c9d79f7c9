"""The verbs of models: train, evaluate, ablate, profile, predict."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from mixpinn.base.config import build_config, parse_overrides
from mixpinn.base.errors import InputError
from mixpinn.cli import options
from mixpinn.cli.data_verbs import app
from mixpinn.cli.output import say, warn


@app.command()
def train(
    source: Annotated[Path, typer.Argument(help="Folder that 'mixpinn simulate' wrote.")],
    out: options.Out,
    model: Annotated[str, typer.Option(help="hybrid, mixpinn, simple-gat, physgnn or row-1 … row-13.")] = "mixpinn",
    width: Annotated[str | None, typer.Option(help="tiny, desk, authors or paper.")] = None,
    epochs: Annotated[int | None, typer.Option(help="Largest number of epochs.")] = None,
    scaling: Annotated[str | None, typer.Option(help="none or standard.")] = None,
    devices: Annotated[int, typer.Option(help="Processes, each with a device of its own.")] = 1,
    split_file: options.SplitFile = None,
    hold_out: options.HoldOut = None,
    config: options.Config = None,
    overrides: options.Set = None,
) -> None:
    """Train one model; an interrupted run continues, to the same loss curve."""
    from mixpinn.dataset import SimulationStore
    from mixpinn.face import simulations_folder
    from mixpinn.reduced.hybrid import HybridModel
    from mixpinn.stages.fit import fit_model
    from mixpinn.stages.samples import SplitConfig, load_samples
    from mixpinn.stages.training import ModelsConfig

    settings = build_config(
        ModelsConfig, {"names": [model]}, *options.settings_layers(config, None, width=width, scaling=scaling),
        {"train": {"max_epochs": epochs}} if epochs else {}, parse_overrides(overrides or []),
    )
    store = SimulationStore.open(simulations_folder(source))
    table, split = load_samples(store, SplitConfig(file=str(split_file) if split_file else None))
    result = fit_model(store, table, split, model, settings, out=out, devices=devices, held_out=hold_out)
    if isinstance(result, HybridModel):
        samples = result.about["training_samples"]
        say(f"{len(result.newton.modes)} modes from {samples} samples; model in {out}")
        return
    say(
        f"{len(result.history)} epochs, best {result.best_epoch} with {result.best_validation_loss:.4f} mm on the "
        f"validation positions ({result.stopped_by}); model in {out}"
    )


@app.command()
def evaluate(
    source: Annotated[Path, typer.Argument(help="Folder that 'mixpinn simulate' wrote.")],
    models: Annotated[list[Path], typer.Argument(help="Folders that 'mixpinn train' wrote.")],
    out: options.Out,
    pictures: Annotated[bool, typer.Option(help="Render the deformed mesh.")] = True,
    paper: Annotated[bool, typer.Option(help="Show the paper's rows too.")] = False,
    split_file: options.SplitFile = None,
    hold_out: options.HoldOut = None,
    threads: options.Threads = None,
) -> None:
    """Metrics on the test positions, pictures and the HTML report."""
    from mixpinn.dataset import SimulationStore
    from mixpinn.evaluation import results_table
    from mixpinn.face import simulations_folder
    from mixpinn.stages.evaluation import EvaluationConfig, evaluate_models
    from mixpinn.stages.samples import SplitConfig, load_samples

    store = SimulationStore.open(simulations_folder(source))
    table, split = load_samples(store, SplitConfig(file=str(split_file) if split_file else None))
    evaluations, report = evaluate_models(
        store, table, split, models, EvaluationConfig(pictures=pictures, with_paper=paper), out=out,
        threads=threads, held_out=hold_out,
    )
    say(results_table(evaluations, with_paper=paper).rich())
    say(f"Report: {report}")


@app.command()
def ablate(
    source: Annotated[str, typer.Argument(help="Label maps, 'phantom', a mesh, or the folder of 'mixpinn simulate'.")],
    out: options.Out,
    protocol: Annotated[str, typer.Option(help="desk or paper.")] = "desk",
    models: Annotated[list[str] | None, typer.Option("--model", help="Only this; repeatable. All fourteen.")] = None,
    hidden: Annotated[int | None, typer.Option(help="Channels a head.")] = None,
    probe: options.ProbeFile = None,
    positions: options.Positions = None,
    split_file: options.SplitFile = None,
    workers: Annotated[int, typer.Option(help="Processes; every core by default.")] = 0,
    threads: Annotated[int, typer.Option(help="CPU threads of each process.")] = 1,
    scheduler: Annotated[str | None, typer.Option(help="Address of a Dask scheduler to use instead.")] = None,
    devices: Annotated[int, typer.Option(help="Processes of each training, each with a device of its own.")] = 1,
    tables_only: Annotated[bool, typer.Option("--tables-only", help="Only write tables of what is finished.")] = False,
    config: options.Config = None,
    overrides: options.Set = None,
) -> None:
    """The paper's experiments: every row trained and tested, with hold-outs; an interrupted run continues."""
    from mixpinn.studies.ablation import run_ablation
    from mixpinn.studies.ablation_config import ABLATION_RUNS, AblationConfig

    if protocol not in ABLATION_RUNS:
        raise InputError(
            f"--protocol {protocol}", expected="one of " + ", ".join(ABLATION_RUNS), got=protocol,
            fix="choose one of them",
        )
    settings = build_config(AblationConfig, asdict(ABLATION_RUNS[protocol]), *options.settings_layers(
        config, overrides, models=models and tuple(models), hidden=hidden,
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
    out: options.Out,
    models: Annotated[list[str] | None, typer.Option("--model", help="Only this model; repeatable.")] = None,
    hidden: Annotated[int | None, typer.Option(help="Channels a head.")] = None,
    threads: Annotated[int | None, typer.Option(help="CPU threads of every method; 1 by default.")] = None,
    repeats: Annotated[int | None, typer.Option(help="Predictions that are timed.")] = None,
    probe: options.ProbeFile = None,
    config: options.Config = None,
    overrides: options.Set = None,
) -> None:
    """Run time of solver, prior and networks on each mesh: time, memory, growth; an interrupted run continues."""
    from mixpinn.studies.profile import ProfileConfig, run_profile

    settings = build_config(ProfileConfig, *options.settings_layers(
        config, overrides, models=models and tuple(models), hidden=hidden, threads=threads, repeats=repeats,
        simulation={"probe": str(probe)} if probe else None,
    ))
    names = [path.stem if path.suffix == ".vtu" else path.name for path in meshes]
    if len(set(names)) < len(names):
        raise InputError(
            "meshes", expected="folders or files of different names", got=", ".join(names), fix="rename one of them",
        )
    run_profile(dict(zip(names, map(options.load_mesh, meshes), strict=True)), settings, out=out)


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
    threads: options.Threads = None,
) -> None:
    """Contact displacement, or the probe's pose, → deformed mesh, for ParaView and 3D Slicer."""
    from mixpinn.face import load, simulations_folder
    from mixpinn.records.answer import checked_output
    from mixpinn.records.doubts import in_short

    checked_output(out)
    if sum(source is not None for source in (contacts, simulations, tip)) != 1:
        raise InputError(
            "predict", expected="one of --contacts, --simulations and --tip", got="none or several",
            fix="give one of them",
        )
    place = None if tip is None else options.read_tip(tip)
    predictor = load(model, threads=threads, warm_up=False)
    if place is not None:
        answer = predictor.press(place, rotation_deg=rotation)
    else:
        from mixpinn.serving.contact_source import SampleAddress
        from mixpinn.stages.prediction import answer_contacts

        source = contacts or SampleAddress(simulations_folder(simulations or Path()), position, rotation, depth)
        answer = answer_contacts(predictor, source)
    answer.save(out)
    for line in answer.describe():
        say(line)
    for line in answer.warnings():
        warn(line)
    if answer.mesh.doubts:
        warn(f"anatomy, mesh or probe were taken with doubts: {in_short(answer.mesh.doubts)}")
    say(f"Deformed mesh: {out}")
