"""The verb that says how good a bundle's answers are: assess."""

from pathlib import Path
from typing import Annotated

import typer

from mixpinn.base.config import build_config
from mixpinn.cli.data_verbs import app
from mixpinn.cli.options import Config, Out, Set, Threads, settings_layers
from mixpinn.cli.output import say, warn


@app.command()
def assess(
    bundle: Annotated[Path, typer.Argument(help="Hybrid model that takes poses.")],
    out: Out,
    poses: Annotated[int | None, typer.Option(help="Presses over the rigid parts; 3.")] = None,
    depth: Annotated[float | None, typer.Option(help="Of each beyond first touch [mm]; 10.")] = None,
    finer: Annotated[str | None, typer.Option(help="What cells are held against: refined, quadratic, halved.")] = None,
    facets: Annotated[
        Path | None, typer.Option(help="The anatomy of 'mixpinn anatomy', or its mesh with a finer surface."),
    ] = None,
    keep: Annotated[bool, typer.Option("--keep", help="Put it into the bundle, whose answers then tell it.")] = False,
    minutes: Annotated[float | None, typer.Option(help="Begin no further solve after this time.")] = None,
    threads: Threads = None,
    config: Config = None,
    overrides: Set = None,
) -> None:
    """The error budget: predictor, contact, discretisation, facets; what tissue and supports change; goes on later."""
    from mixpinn.serving.bundle_budget import keep_budget
    from mixpinn.stages.budget.facets import finer_facets
    from mixpinn.stages.budget.make import PAGE_FILE, make_budget
    from mixpinn.stages.budget.variants import BudgetConfig

    settings = build_config(BudgetConfig, *settings_layers(
        config, overrides, poses=poses, depth=depth, finer=finer, threads=threads,
    ))
    budget = make_budget(
        bundle, settings, out=out, facets=None if facets is None else finer_facets(facets, out=out / "facets"),
        minutes=float("inf") if minutes is None else minutes,
    )
    say(budget.sentence)
    if not budget.complete:
        warn("not everything was solved, or some solves did not converge; the same command goes on")
    if keep:
        keep_budget(budget, bundle)
    say(f"Error budget: {out / PAGE_FILE}")
