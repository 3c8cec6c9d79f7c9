"""The application, and the verbs that make data: label maps, meshes, simulations."""

from pathlib import Path
from typing import Annotated

import typer

from mixpinn.base.config import build_config
from mixpinn.cli import options
from mixpinn.cli.output import say, warn
from mixpinn.records.joint_frame import JOINTS_FILE

app = typer.Typer(
    name="mixpinn", no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False,
    help="From CT label maps to a trained model of how soft tissue and rigid bodies move.",
)
export_app = typer.Typer(help="Write scenes for other simulators.", no_args_is_help=True)
import_app = typer.Typer(help="Read recordings of other simulators.", no_args_is_help=True)
app.add_typer(export_app, name="export")
app.add_typer(import_app, name="import")


@app.command()
def anatomy(
    source: Annotated[str, typer.Argument(help="Folder of label images, one multi-label image, or 'phantom'.")],
    out: options.Out,
    names: Annotated[Path | None, typer.Option(help="Name table of a multi-label image, total or total-v1.")] = None,
    body: Annotated[str | None, typer.Option(help="Name or file of the body.")] = None,
    rigid: options.Rigid = None,
    target: options.Target = None,
    paper_parts: options.PaperParts = False,
    layers: options.Layers = False,
    ct: options.CtFile = None,
    soft: Annotated[list[str] | None, typer.Option(help="A further soft tissue; repeatable.")] = None,
    repair: Annotated[bool, typer.Option(help="Repair what the label check finds.")] = False,
    seed: Annotated[int | None, typer.Option(help="Vary the phantom.")] = None,
    config: options.Config = None,
    overrides: options.Set = None,
) -> None:
    """Label maps → one checked label map in the world frame."""
    from mixpinn.stages.anatomy import AnatomyConfig, make_anatomy, source_settings
    from mixpinn.stages.setup_tables import findings_table

    settings = build_config(AnatomyConfig, *options.settings_layers(
        config, overrides, **source_settings(source), names=names and str(names), body=body,
        soft=soft and tuple(soft), repair=repair or None, seed=seed,
        **options.role_options(rigid, target, paper_parts, layers, ct),
    ))
    result = make_anatomy(settings, out=out)
    label_map = result.label_map
    say(f"{', '.join(label_map.names)}: {'×'.join(map(str, label_map.labels.shape))} voxels in {out}")
    if result.findings:
        say(findings_table(result.findings).rich())


@app.command()
def mesh(
    source: Annotated[Path, typer.Argument(help="Folder that 'mixpinn anatomy' wrote, or a ready .vtu.")],
    out: options.Out,
    size: Annotated[float | None, typer.Option(help="1 is the paper's resolution, larger is coarser.")] = None,
    mesher: Annotated[str | None, typer.Option(help="cgal, tetwild or auto.")] = None,
    fixed: Annotated[Path | None, typer.Option(help="File of fixed node indices for a ready .vtu.")] = None,
    config: options.Config = None,
    overrides: options.Set = None,
) -> None:
    """Label map → labelled tetrahedral mesh with its statistics, quality and fidelity."""
    from mixpinn.stages.mesh import MeshConfig, make_mesh, open_source
    from mixpinn.stages.setup_tables import fidelity_table, quality_table

    settings = build_config(MeshConfig, *options.settings_layers(
        config, overrides, size=size, mesher=mesher, fixed=fixed and str(fixed),
    ))
    result = make_mesh(open_source(source), settings, out=out)
    say(result.statistics.table())
    say(quality_table(result.quality).rich())
    if result.fidelity is not None:
        say(fidelity_table(result.fidelity).rich())


@app.command()
def simulate(
    source: options.MeshSource,
    out: options.Out,
    protocol: options.Protocol = None,
    probe: options.ProbeFile = None,
    positions: options.Positions = None,
    paper_constants: options.PaperConstants = False,
    joints: options.Joints = None,
    support: options.Front = None,
    hold: options.Hold = None,
    caps: options.Caps = None,
    membrane: options.Skin = None,
    workers: Annotated[int | None, typer.Option(help="Processes; every core by default.")] = None,
    scheduler: Annotated[str | None, typer.Option(help="Address of a Dask scheduler to use instead.")] = None,
    config: options.Config = None,
    overrides: options.Set = None,
) -> None:
    """Press the probe over the grid of poses; finished poses are kept if the command is stopped."""
    from mixpinn.stages.simulation import failed_for_valleys, for_patients, make_simulations

    settings = options.simulation_settings(
        config, overrides, protocol=protocol, probe=probe, positions=positions, paper_constants=paper_constants,
        workers=workers, restraints=options.restraint_options(joints, support, hold, caps, membrane),
    )
    meshed = options.load_mesh(source)
    if (source / JOINTS_FILE).is_file() and not paper_constants and protocol not in ("paper", "sofa-replay"):
        settings = for_patients(settings, meshed.tissue_names)
    store, summary = make_simulations(meshed, settings, out=out, scheduler=scheduler)
    say(summary.markdown())
    if summary.failed or summary.failed_steps:
        warn(f"{summary.failed} poses and {summary.failed_steps} steps failed; see {out}/poses.png")
        if told := failed_for_valleys(store):
            warn(told)


@app.command()
def inspect(
    source: Annotated[Path, typer.Argument(help="Folder that 'mixpinn simulate' wrote.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Also as JSON, every step and cell.")] = None,
) -> None:
    """Steps that did not converge, and det F of the others, with each cell that is turned inside out."""
    from mixpinn.dataset import SimulationStore
    from mixpinn.dataset.inspection import inspect_store
    from mixpinn.face import simulations_folder

    found = inspect_store(SimulationStore.open(simulations_folder(source)))
    say(found.markdown())
    if out is not None:
        found.save(out)
    if found.unconverged or found.non_positive:
        warn(f"{len(found.unconverged)} steps did not converge, {len(found.non_positive)} times det F ≤ 0 in a cell")


@app.command()
def dataset(
    source: Annotated[Path, typer.Argument(help="Folder that 'mixpinn simulate' wrote.")],
    split_file: options.SplitFile = None,
) -> None:
    """Positions, poses and samples of each part of the split."""
    from mixpinn.dataset import SimulationStore, dataset_table
    from mixpinn.evaluation import dataset_counts_table
    from mixpinn.face import simulations_folder
    from mixpinn.stages.samples import SplitConfig, load_samples

    store = SimulationStore.open(simulations_folder(source))
    table, split = load_samples(store, SplitConfig(file=str(split_file) if split_file else None))
    say(dataset_counts_table(dataset_table(table, split)).rich())
