"""The error budget of a bundle: a few presses solved again with one thing changed at a time."""

import time
from collections.abc import Sequence
from pathlib import Path

from mixpinn.base.errors import InputError
from mixpinn.base.files import make_folder, write_text
from mixpinn.base.progress import progress_bar
from mixpinn.base.rundir import finish_run, run_scope, start_run
from mixpinn.evaluation.budget_page import budget_page
from mixpinn.geometry.probe_pose import probe_rotation
from mixpinn.records import TissueMesh
from mixpinn.records.error_budget import BUDGET_FILE, BudgetKind, ErrorBudget
from mixpinn.serving import HybridPredictor, load_predictor
from mixpinn.stages.budget.entries import PREDICTOR, budget_of, entry_of, of_single_tissue
from mixpinn.stages.budget.solves import Found, Press, presses, solve_kept
from mixpinn.stages.budget.variant import Variant
from mixpinn.stages.budget.variants import MODULUS, BudgetConfig, base_scene, present, variants

PAGE_FILE = "budget.md"
_SOLVES = "solves"


@run_scope()
def make_budget(
    bundle: Path | str, config: BudgetConfig, *, out: Path | str, facets: TissueMesh | None = None,
    minutes: float = float("inf"),
) -> ErrorBudget:
    """Solve what is missing, and write ``budget.json`` and ``budget.md`` into the run directory `out`.

    Args:
        bundle: a hybrid model that takes poses.
        config: what is changed by how much.
        out: run directory; an unfinished run in it continues.
        facets: a mesh of the same anatomy whose surfaces are finer, for the error of the facets.
        minutes: begin no further solve after this time; the budget says what is missing.

    Raises:
        InputError: a bundle that takes no poses, no skin over the rigid parts, or `out` holds another run.
    """
    predictor = load_predictor(bundle, warm_up=False, with_budget=False)
    if not isinstance(predictor, HybridPredictor) or predictor.pose is None:
        raise InputError(
            str(bundle), expected="a hybrid bundle that takes poses", got="a model that does not",
            fix="fit the hybrid model on simulations that know their probe",
        )
    folder = Path(out)
    hashes = {"mesh": predictor.mesh.hash(), **({} if facets is None else {"facets": facets.hash()})}
    start_run(folder, "assess", config, input_hashes=hashes)
    make_folder(folder / _SOLVES)
    base = base_scene(predictor, config)
    rotation = probe_rotation(0.0, predictor.pose.domain.direction)
    lines = presses(predictor.mesh, rotation, config.poses)
    tips = [press.tip(base, config.depth) for press in lines]
    own = Variant("", BudgetKind.ERROR, "", lambda: base)
    plan = [own, *variants(base, config, facets=facets)]
    solved = _solve(plan, lines, predictor.mesh, folder / _SOLVES, config.depth, minutes)
    kept = [index for index in range(len(lines)) if (0, index) in solved and solved[0, index].converged]
    if not kept:
        raise InputError(
            str(bundle), expected="a press that the full solver finishes", got="none so far",
            fix="give it more --minutes or press less deep",
        )
    answers = {
        index: Found.of(predictor.press(tips[index], rotation=rotation), predictor.mesh) for index in kept
    }
    whole = {index: solved[0, index] for index in kept}
    words = "full solve of the same cells → prediction"
    entries = [entry_of(PREDICTOR, BudgetKind.ERROR, words, whole, [answers], predictor.mesh, planned=len(lines))]
    for source in dict.fromkeys(variant.source for variant in plan[1:]):
        of_source = [number for number, variant in enumerate(plan) if variant.source == source]
        ends = [{
            i: solved[n, i].extrapolated(whole[i], plan[n].scale)
            for i in kept if (n, i) in solved and solved[n, i].converged
        } for n in of_source]
        words = f"{present(source, base)} → {', '.join(plan[number].value for number in of_source)}"
        kind = plan[of_source[0]].kind
        note = plan[of_source[0]].note
        entries.append(entry_of(source, kind, words, whole, ends, predictor.mesh, planned=len(lines), note=note))
    if config.sensitivity and MODULUS not in {entry.source for entry in entries}:
        entries.append(of_single_tissue(whole, predictor.mesh, config.modulus))
    budget = budget_of(
        predictor, config.depth, tips, whole, entries, complete=len(solved) == len(plan) * len(lines),
    )
    budget.save(folder / BUDGET_FILE)
    write_text(folder / PAGE_FILE, budget_page(budget))
    if budget.complete:
        finish_run(folder, {"total_force": budget.total_force, "total_motions": budget.total_motions})
    return budget


def _solve(
    plan: Sequence[Variant], lines: Sequence[Press], mesh: TissueMesh, folder: Path, depth: float, minutes: float,
) -> dict[tuple[int, int], Found]:
    """By variant and press; press by press within a variant, so that its factorizations serve all of them."""
    deadline, solved = time.monotonic() + 60.0 * minutes, {}
    with progress_bar() as bar:
        task = bar.add_task("full solves", total=len(plan) * len(lines))
        for number, variant in enumerate(plan):
            scene = variant.scene() if time.monotonic() < deadline else None
            for index, press in enumerate(lines):
                if scene is not None and time.monotonic() < deadline:
                    solved[number, index] = solve_kept(
                        folder, scene, press, mesh, depth=depth, same_vertices=variant.same_vertices,
                    )
                bar.advance(task)
    return solved
