"""``python -m validation``: run the checks, write docs/validation.md, print the figures.

The last line printed is a JSON list of objects with ``check``, ``value``, ``bar`` and ``met``. Checks that need a long
run are not made again by default: their figures are those that the page keeps from the last run. ``--full`` makes them
all (SOFA's poses one after another, resumable in ``--cache``; cost against size), ``--only`` makes the named ones. The
rows of the whole protocol come from the summaries of ``mixpinn simulate``: ``--summary FILE`` for the paper's mesh,
``--own-summary FILE`` for the own one.
"""

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path

from mixpinn.base.cache import cache_folder
from validation import closed_form, joints, layers, linear_elasticity, material, protocol, quadratic, scaling
from validation.contact import balance, friction, hertz, pressure
from validation.page import figure, stored_results, write_page
from validation.result import Result, Section
from validation.sofa import contact as sofa_contact
from validation.sofa import imposed as sofa_imposed
from validation.sofa import transient as sofa_transient

ROOT = Path(__file__).parents[1]
TITLES = {
    "material": "Materials", "closed_form": "Patch test, uniaxial stretch, simple shear",
    "linear_elasticity": "Linear elasticity and orders of convergence", "hertz": "Hertz", "friction": "Friction",
    "quadratic": "Quadratic tetrahedra",
    "balance": "Equilibrium of rigid bodies and probe", "joints": "Joints", "layers": "Layers",
    "pressure": "Contact area and pressure",
    "sofa_imposed": "SOFA's frames, contact displacements imposed",
    "sofa_contact": "SOFA's static fields, own contact", "sofa_transient": "SOFA's transient frames, own contact",
    "protocol": "The paper's protocol", "own_mesh": "The protocol on the own mesh", "scaling": "Cost against size",
}
"""Title of each check's section, in the page's order."""
LONG = ("sofa_imposed", "sofa_contact", "sofa_transient", "scaling")
"""Checks that take more than some minutes."""


def checks(options: argparse.Namespace) -> dict[str, Callable[[], Section]]:
    """All checks, by name."""
    pictures, cache = options.page.parent / options.page.stem, options.cache
    return {
        "material": lambda: material.run(pictures),
        "closed_form": lambda: closed_form.run(pictures),
        "linear_elasticity": lambda: linear_elasticity.run(pictures),
        "hertz": lambda: hertz.run(pictures),
        "friction": lambda: friction.run(pictures),
        "quadratic": lambda: quadratic.run(pictures),
        "balance": lambda: balance.run(pictures),
        "joints": lambda: joints.run(pictures),
        "layers": lambda: layers.run(pictures),
        "pressure": lambda: pressure.run(pictures),
        "sofa_imposed": lambda: sofa_imposed.run(pictures, cache=cache / "imposed", full=options.full),
        "sofa_contact": lambda: sofa_contact.run(pictures, cache=cache / "contact"),
        "sofa_transient": lambda: sofa_transient.run(pictures, cache=cache / "contact", imposed=cache / "imposed"),
        "protocol": lambda: protocol.run(options.summary, pictures),
        "own_mesh": lambda: protocol.run_own(options.own_summary, pictures),
        "scaling": lambda: scaling.run(pictures),
    }


def is_made(name: str, options: argparse.Namespace) -> bool:
    """Whether the check is made now; the others keep what the page has."""
    if options.only:
        return name in options.only
    if name in ("protocol", "own_mesh"):
        return (options.summary if name == "protocol" else options.own_summary) is not None
    return options.full or name not in LONG


def main(arguments: list[str] | None = None) -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(prog="python -m validation", description=__doc__)
    parser.add_argument("--full", action="store_true", help="the long checks, too, on all of SOFA's poses")
    parser.add_argument("--summary", type=Path, help="summary.json of a simulation of the paper's protocol")
    parser.add_argument("--own-summary", type=Path, help="the same of a simulation on the own mesh")
    parser.add_argument("--only", nargs="+", choices=list(TITLES), metavar="CHECK", help="run these checks alone")
    parser.add_argument("--cache", type=Path, default=cache_folder() / "validation", help="folder of kept simulations")
    parser.add_argument("--page", type=Path, default=ROOT / "docs" / "validation.md", help="page to write")
    options = parser.parse_args(arguments)
    results: list[Result] = []
    for name, check in checks(options).items():
        began = time.perf_counter()
        if is_made(name, options):
            section = check()
            write_page(options.page, [section], order=list(TITLES.values()))
            found, source = section.results, f"{time.perf_counter() - began:.1f} s"
        elif options.only:
            continue
        else:
            found, source = stored_results(options.page, TITLES[name]), "kept from the last run"
            if not found:
                found = (Result(TITLES[name], float("nan"), "made", False),)
        print(f"{name}: {source}", flush=True)
        for result in found:
            print(f"  {'met   ' if result.met else 'MISSED'} {result.check}: {figure(result.value)} ({result.bar})",
                  flush=True)
        results += found
    print(json.dumps([result.json() for result in results], ensure_ascii=False))


if __name__ == "__main__":
    main()
