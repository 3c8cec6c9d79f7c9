"""The error budget as a page of Markdown: one sentence, errors, sensitivities."""

from mixpinn.evaluation.table import Table
from mixpinn.records.error_budget import BudgetEntry, BudgetKind, ErrorBudget

_ABOUT = {
    BudgetKind.ERROR: (
        "Errors", "How far the answers are from the converged solution of the same equations, tissues and supports.",
    ),
    BudgetKind.SENSITIVITY: (
        "What is not known of the patient", "How far the answers change with it; not an error of the computation.",
    ),
}


def budget_page(budget: ErrorBudget) -> str:
    """The page."""
    lines = [
        f"# Error budget of {budget.bundle}", "", f"**{budget.sentence}**", "",
        f"{len(budget.tips)} presses, {budget.depth:g} mm beyond first touch; {budget.discretisation}. Each figure is "
        "the largest over the presses. All of them are changes of the full solution when one thing is changed, but for "
        "the predictor's, which is against the full solution of its own cells.", "",
    ]
    if not budget.complete:
        lines += ["Not everything was solved yet, or some solves did not converge: see the notes.", ""]
    for kind, (title, about) in _ABOUT.items():
        entries = [entry for entry in budget.entries if entry.kind is kind]
        if not entries:
            continue
        lines += [_table(title, entries, budget).markdown(), about, ""]
        lines += [f"- {entry.source}: {entry.sentence}{_noted(entry)}" for entry in entries]
        lines.append("")
    return "\n".join(lines)


def budget_tables(budget: ErrorBudget | None) -> tuple[Table, ...]:
    """Errors and, where they were looked at, sensitivities; nothing without a budget."""
    if budget is None:
        return ()
    return tuple(
        _table(title, [entry for entry in budget.entries if entry.kind is kind], budget)
        for kind, (title, _) in _ABOUT.items() if any(entry.kind is kind for entry in budget.entries)
    )


def _table(title: str, entries: list[BudgetEntry], budget: ErrorBudget) -> Table:
    names = tuple(budget.motions)
    rows: list[tuple[str | float | None, ...]] = [(
        entry.source, entry.varied, _round(entry.force, 2), _percent(entry.force_share),
        *(_round(entry.motions.get(name), 3) for name in names), _round(entry.field, 4),
    ) for entry in entries]
    if entries and entries[0].kind is BudgetKind.ERROR:
        rows.append((
            "all of them", "root of the sum of squares", _round(budget.total_force, 2),
            _percent(budget.total.force),
            *(_round(budget.total_motions.get(name), 3) for name in names), None,
        ))
    return Table(title, (
        "Source", "Changed", "Force [N]", "Force [%]",
        *(f"{name.removeprefix('vertebrae_')} [mm]" for name in names), "Field, mean [mm]",
    ), tuple(rows))


def _noted(entry: BudgetEntry) -> str:
    return f" ({entry.note})" if entry.note else ""


def _round(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)


def _percent(share: float | None) -> int | None:
    return None if share is None else round(100.0 * share)
