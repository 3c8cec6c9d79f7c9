"""The verbs that run several stages, and the exchange with other simulators."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from mixpinn.base.config import build_config
from mixpinn.cli import options
from mixpinn.cli.data_verbs import app, export_app, import_app
from mixpinn.cli.output import say


@app.command()
def run(
    config: Annotated[Path, typer.Argument(help="Settings of all stages as TOML or JSON.")],
    out: options.Out,
    joints: options.Joints = None,
    support: options.Front = None,
    hold: options.Hold = None,
    caps: options.Caps = None,
    membrane: options.Skin = None,
    overrides: options.Set = None,
    threads: options.Threads = None,
) -> None:
    """The whole pipeline, from label maps to report; an interrupted run continues."""
    from mixpinn.pipeline import RunConfig, run_pipeline

    restraints = options.restraint_options(joints, support, hold, caps, membrane)
    settings = options.settings_layers(config, overrides, simulation=restraints or None)
    run_pipeline(build_config(RunConfig, *settings), out=out, threads=threads)


@app.command()
def demo(out: options.Out = Path("runs/demo"), overrides: options.Set = None, threads: options.Threads = None) -> None:
    """The whole pipeline on the built-in phantom."""
    from mixpinn.pipeline import DEMO, RunConfig, run_pipeline

    settings = build_config(RunConfig, asdict(DEMO), *options.settings_layers(None, overrides))
    run_pipeline(settings, out=out, threads=threads)


@app.command()
def onboard(
    source: Annotated[str, typer.Argument(help="Folder of label images, one multi-label image, or 'phantom'.")],
    out: options.Out,
    poses: Annotated[int | None, typer.Option(help="Poses to simulate and learn from; 0 stops at the prior.")] = None,
    rigid: options.Rigid = None,
    target: options.Target = None,
    paper_parts: options.PaperParts = False,
    layers: options.Layers = False,
    ct: options.CtFile = None,
    probe: options.ProbeFile = None,
    size: Annotated[float | None, typer.Option(help="Mesh size: 2 by default, with quadratic cells.")] = None,
    joints: options.Joints = None,
    support: options.Front = None,
    hold: options.Hold = None,
    caps: options.Caps = None,
    membrane: options.Skin = None,
    workers: Annotated[int | None, typer.Option(help="Processes; every core by default.")] = None,
    pictures: Annotated[bool, typer.Option(help="Render the deformed mesh.")] = True,
    config: options.Config = None,
    overrides: options.Set = None,
) -> None:
    """Label maps → a predictor bundle, usable after the prior and better after each round of poses; with a report."""
    from mixpinn.pipeline import OnboardingConfig, onboard
    from mixpinn.stages.anatomy import source_settings

    roles = options.role_options(rigid, target, paper_parts, layers, ct)
    anatomy: dict[str, Any] = {**source_settings(source), **roles}
    restraints = options.restraint_options(joints, support, hold, caps, membrane)
    simulation = {"probe": probe and str(probe), "workers": workers, **restraints}
    settings = build_config(OnboardingConfig, *options.settings_layers(
        config, overrides, poses=poses, pictures=None if pictures else False,
        anatomy={**anatomy, "repair": source != "phantom"}, mesh={"size": size} if size else None,
        simulation={key: value for key, value in simulation.items() if value is not None} or None,
    ))
    say(f"Predictor: {onboard(settings, out=out)}")


@app.command()
def seal(
    folder: Annotated[Path, typer.Argument(help="Folder that an older version wrote, and that you trust.")],
) -> None:
    """Add the manifest, by which altered files are noticed, to a folder that has none."""
    from mixpinn.stages.seal import seal_folder

    sealed = seal_folder(folder)
    for where, artefact in sealed:
        say(f"{where}: manifest of a {artefact.kind}")
    if not sealed:
        say(f"{folder} has its manifest")


@export_app.command("sofa")
def export_sofa(
    source: options.MeshSource,
    out: options.Out,
    protocol: options.Protocol = None,
    probe: options.ProbeFile = None,
    positions: options.Positions = None,
    paper_constants: options.PaperConstants = False,
    config: options.Config = None,
    overrides: options.Set = None,
) -> None:
    """The same set-up as a documented SofaPython3 scene with a recorder."""
    from mixpinn.stages.sofa import export_sofa as write

    settings = options.simulation_settings(
        config, overrides, protocol=protocol, probe=probe, positions=positions, paper_constants=paper_constants,
    )
    say(f"Scene: {write(options.load_mesh(source), settings, out=out)}")


@import_app.command("sofa")
def import_sofa(
    recordings: Annotated[Path, typer.Argument(help="Folder of recordings pose_PPP_RRR.npz.")],
    mesh_source: Annotated[Path, typer.Option("--mesh", help="Mesh that they were made on: folder or .vtu.")],
    positions: Annotated[Path, typer.Option(help="File with one listed probe position a line.")],
    out: options.Out,
    paper_constants: options.PaperConstants = False,
    scene: Annotated[Path | None, typer.Option(help="Folder of 'mixpinn export sofa' that was recorded.")] = None,
    config: options.Config = None,
    overrides: options.Set = None,
) -> None:
    """SOFA recordings, and the constants they were made with → simulations that 'mixpinn train' reads."""
    from mixpinn.interop import PAPER_SOFA, SofaConstants
    from mixpinn.stages.sofa import import_sofa_recordings

    known = [asdict(PAPER_SOFA)] if paper_constants else []
    known += [asdict(SofaConstants.of_scene(scene))] if scene is not None else []
    constants = build_config(SofaConstants, *known, *options.settings_layers(config, overrides))
    store = import_sofa_recordings(recordings, options.load_mesh(mesh_source), constants, positions=positions, out=out)
    say(f"{len(store.poses)} poses in {out}")
