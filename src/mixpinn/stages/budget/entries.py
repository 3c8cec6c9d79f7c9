"""Entries of an error budget, and the sentences that say what they mean."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from mixpinn.base.arrays import FloatArray
from mixpinn.records import TissueMesh
from mixpinn.records.answer import discretisation_of
from mixpinn.records.error_budget import BudgetEntry, BudgetKind, ErrorBudget
from mixpinn.serving import HybridPredictor
from mixpinn.stages.budget.restraints import HELD, JOINTS, SUPPORT
from mixpinn.stages.budget.solves import Found
from mixpinn.stages.budget.variants import CELLS, FACETS, FIXED, FRICTION, GAP, MODULUS, PENALTY, POISSON

PREDICTOR = "predictor"


def entry_of(
    source: str, kind: BudgetKind, varied: str, base: dict[int, Found], ends: Sequence[dict[int, Found]],
    mesh: TissueMesh, *, planned: int, note: str = "",
) -> BudgetEntry:
    """The largest changes over presses and ends.

    Args:
        source: what was changed.
        kind: whether the change shows an error or a sensitivity.
        varied: from what to what, in words.
        base: of each press what the bundle's own scene does.
        ends: for each value that it was changed to, what the presses do then, as far as they were solved.
        mesh: of the bundle.
        planned: presses that there are to be.
        note: what a reader must know beside the figures.
    """
    pairs = [(base[index], found) for end in ends for index, found in end.items()]
    done = min((len(end) for end in ends), default=0)
    if not pairs:
        return BudgetEntry(source, kind, varied, None, None, {}, 0.0, None, 0, "Not solved yet.")
    force = max(float(np.linalg.norm(after.force - before.force)) for before, after in pairs)
    shares = np.array([
        np.linalg.norm(after.force) / max(float(np.linalg.norm(before.force)), 1e-9) - 1.0 for before, after in pairs
    ])
    share = float(shares[np.abs(shares).argmax()])
    if not ((shares >= 0.0).all() or (shares <= 0.0).all()):
        share = abs(share)
    moved: FloatArray = np.max([
        np.linalg.norm(after.translations - before.translations, axis=1) for before, after in pairs
    ], axis=0)
    fields = [
        float(np.linalg.norm(after.field - before.field, axis=1).mean()) for before, after in pairs if len(after.field)
    ]
    motions = {name: float(value) for name, value in zip(mesh.rigid_names, moved, strict=True)}
    motion_share = max(
        float(np.linalg.norm(after.translations - before.translations, axis=1).max(initial=0.0))
        / max(float(np.linalg.norm(before.translations, axis=1).max(initial=0.0)), 1e-9) for before, after in pairs
    )
    notes = [] if done == planned else [f"{done} of {planned} presses were solved and converged"]
    notes += [note] if note else []
    return BudgetEntry(
        source, kind, varied, force, share, motions, motion_share, max(fields, default=None), done,
        _said(source, force, share, motions), "; ".join(notes),
    )


def of_single_tissue(base: dict[int, Found], mesh: TissueMesh, modulus: float) -> BudgetEntry:
    """A single tissue without joints: at a given pose forces grow with its modulus and nothing else changes.

    Args:
        base: of each press what the bundle's own scene does.
        mesh: of the bundle.
        modulus: by what share the modulus is changed.
    """
    force = modulus * max(float(np.linalg.norm(found.force)) for found in base.values())
    motions = dict.fromkeys(mesh.rigid_names, 0.0)
    return BudgetEntry(
        MODULUS, BudgetKind.SENSITIVITY, f"± {100.0 * modulus:g} %", force, modulus, motions, 0.0, 0.0,
        len(base), _said(MODULUS, force, modulus, motions),
        "exact but for the penalty of contact: with one tissue, forces are proportional to its modulus and motions do "
        "not depend on it; with several, their ratio is what counts",
    )


_WORDS = {
    PREDICTOR: "the fast answer itself", PENALTY: "how hard contact is", GAP: "the gap at which contact begins",
    CELLS: "the size of the mesh's cells", FACETS: "the facets of the surfaces", MODULUS: "the stiffness of tissue",
    POISSON: "how far tissue can be squeezed", FRICTION: "the friction of the skin", FIXED: "where the body is held",
    JOINTS: "how the vertebrae hang together", SUPPORT: "what the body lies on", HELD: "which bones are held",
}
"""Sources for a reader who presses backs."""


def _said(source: str, force: float, share: float, motions: dict[str, float]) -> str:
    """One sentence for a reader who presses backs."""
    part = max(motions, key=lambda name: motions[name], default="")
    percent = f"{100.0 * share:+.0f} %" if abs(share) >= 0.005 else "less than 1 %"
    by = f"the force by up to {force:.1f} N ({percent})"
    if part and motions[part] < 0.005:
        by += " and motions hardly at all"
    elif part:
        by += f" and the motion of {_short(part)} by up to {motions[part]:.2f} mm"
    if source == PREDICTOR:
        return f"Computing fast instead of solving in full changes {by}."
    words = _WORDS.get(source, source)
    return f"{words[0].upper()}{words[1:]} changes {by}."


def budget_of(
    predictor: HybridPredictor, depth: float, tips: Sequence[FloatArray], base: dict[int, Found],
    entries: Sequence[BudgetEntry], *, complete: bool,
) -> ErrorBudget:
    """The whole budget.

    Args:
        predictor: of the bundle.
        depth: of the presses [mm].
        tips: at the end of each press that was planned [mm], shape (3,) each.
        base: of each press that was solved what the bundle's own scene does.
        entries: of all sources.
        complete: whether all that was planned was solved.
    """
    names = predictor.mesh.rigid_names
    force = float(np.mean([np.linalg.norm(found.force) for found in base.values()]))
    moved = np.mean([np.linalg.norm(found.translations, axis=1) for found in base.values()], axis=0)
    errors = [entry for entry in entries if entry.kind is BudgetKind.ERROR and entry.force is not None]
    unknowns = [entry for entry in entries if entry.kind is BudgetKind.SENSITIVITY and entry.force is not None]
    motions = {name: float(value) for name, value in zip(names, moved, strict=True)}
    total_force = _root(entry.force or 0.0 for entry in errors)
    total_motions = {name: _root(entry.motions.get(name, 0.0) for entry in errors) for name in names}
    complete = complete and all(entry.solved == len(base) == len(tips) for entry in entries)
    budget = ErrorBudget(
        predictor.name, discretisation_of(predictor.mesh), depth,
        tuple((float(x), float(y), float(z)) for x, y, z in tips), force, motions, tuple(entries), total_force,
        total_motions, "", complete,
    )
    return replace(budget, sentence=_whole(budget, errors, unknowns))


def _whole(budget: ErrorBudget, errors: Sequence[BudgetEntry], unknowns: Sequence[BudgetEntry]) -> str:
    total, motions = budget.total, budget.motions
    begin = f"When the probe presses {budget.depth:g} mm deep, the skin pushes back with about {budget.force:.0f} N"
    largest = max(errors, key=lambda entry: abs(entry.force_share or 0.0))
    end = f"that force may be wrong by about {total.force * budget.force:.1f} N ({100.0 * total.force:.0f} %)"
    why = f"mostly by {_WORDS[largest.source]}"
    if motions:
        part = max(motions, key=lambda name: motions[name])
        most = max(errors, key=lambda entry: entry.motion_share)
        begin += f" and {_short(part)} moves by about {motions[part]:.1f} mm"
        also = f"that motion by about {total.motion * motions[part]:.2f} mm ({100.0 * total.motion:.0f} %)"
        same = most.source == largest.source
        end += f" and {also}, both {why}" if same else f", {why}, and {also}, mostly by {_WORDS[most.source]}"
    else:
        end += f", {why}"
    known = max(unknowns, key=lambda entry: entry.motion, default=None)
    more = "" if known is None else (
        f"; of what is not known of the patient, {_WORDS[known.source]} counts most: it changes motions by up to "
        f"{known.motion:.2f} mm"
    )
    return f"{begin}; {end}{more}."


def _short(part: str) -> str:
    return part.removeprefix("vertebrae_")


def _root(values: Iterable[float]) -> float:
    return float(np.sqrt(sum(value**2 for value in values)))
