"""The error budget that a bundle carries, by its manifest."""

from pathlib import Path

from mixpinn.base.errors import InputError
from mixpinn.records import TissueMesh
from mixpinn.records.answer import discretisation_of
from mixpinn.records.error_budget import BUDGET_FILE, ErrorBudget
from mixpinn.reduced.hybrid import BUNDLE


def keep_budget(budget: ErrorBudget, bundle: Path | str) -> None:
    """Write ``budget.json`` into a bundle and its manifest; what is fitted there anew drops it again.

    Raises:
        InputError: no bundle, or a budget of another discretisation.
    """
    BUNDLE.check(bundle)
    budget.save(Path(bundle) / BUDGET_FILE)
    BUNDLE.seal_more(bundle, [BUDGET_FILE])


def load_budget(bundle: Path | str, mesh: TissueMesh) -> ErrorBudget | None:
    """The budget that a bundle's manifest lists; None where there is none.

    Args:
        bundle: folder of the bundle.
        mesh: that the bundle is used on.

    Raises:
        InputError: a damaged budget, or one of another mesh or element.
    """
    if not BUNDLE.lists(bundle, BUDGET_FILE):
        return None
    BUNDLE.check(bundle, BUDGET_FILE)
    budget = ErrorBudget.load(Path(bundle) / BUDGET_FILE)
    if budget.discretisation != discretisation_of(mesh):
        raise InputError(
            str(Path(bundle) / BUDGET_FILE), expected=f"the error budget of {discretisation_of(mesh)}",
            got=f"that of {budget.discretisation}", fix="run 'mixpinn assess' on this bundle again",
        )
    return budget
