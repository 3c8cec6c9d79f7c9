"""``python -m benchmarks.validation``: run the checks, write docs/validation.md, print the figures.

The last line printed is a JSON list of objects with ``check``, ``value``, ``bar`` and ``met``. By default the two long
checks are cut short or left out: ``--full`` imposes SOFA's contact on all its poses (resumable), ``--scaling`` measures
cost against size. The rows of the whole protocol come from the summaries of ``mixpinn simulate``: ``--summary FILE`` for
the paper's mesh, ``--own-summary FILE`` for the own one.
"""

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.validation import (
    balance,
    closed_form,
    friction,
    hertz,
    linear_elasticity,
    material,
    pressure,
    protocol,
    scaling,
    sofa_contact,
    sofa_imposed,
    sofa_transient,
)
from benchmarks.validation.page import figure, write_page
from benchmarks.validation.result import Section

ROOT = Path(__file__).parents[2]
TITLES = (
    "Materials", "Patch test, uniaxial stretch, simple shear", "Linear elasticity and orders of convergence", "Hertz",
    "Friction", "Equilibrium of rigid bodies and probe", "SOFA's frames, contact displacements imposed",
    "SOFA's static fields, own contact", "SOFA's transient frames, own contact", "Contact area and pressure",
    "The paper's protocol", "The protocol on the own mesh", "Cost against size",
)
"""Sections of the page in their order."""


def checks(options: argparse.Namespace) -> dict[str, Callable[[], Section]]:
    """The checks to run, by name."""
    pictures, cache = options.page.parent / options.page.stem, options.cache
    known: dict[str, Callable[[], Section]] = {
        "material": lambda: material.run(pictures),
        "closed_form": lambda: closed_form.run(pictures),
        "linear_elasticity": lambda: linear_elasticity.run(pictures),
        "hertz": lambda: hertz.run(pictures),
        "friction": lambda: friction.run(pictures),
        "balance": lambda: balance.run(pictures),
        "sofa_imposed": lambda: sofa_imposed.run(pictures, cache=cache / "imposed", full=options.full),
        "sofa_contact": lambda: sofa_contact.run(pictures, cache=cache / "contact"),
        "sofa_transient": lambda: sofa_transient.run(pictures, cache=cache / "contact", full=options.full),
        "pressure": lambda: pressure.run(pictures),
        "protocol": lambda: protocol.run(options.summary),
        "own_mesh": lambda: protocol.run_own(options.own_summary),
        "scaling": lambda: scaling.run(pictures),
    }
    if options.only:
        return {name: known[name] for name in options.only}
    if not options.scaling:
        del known["scaling"]
    return known


def main(arguments: list[str] | None = None) -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.validation", description=__doc__)
    parser.add_argument("--full", action="store_true", help="all poses of the imposed check")
    parser.add_argument("--scaling", action="store_true", help="cost against size, too")
    parser.add_argument("--summary", type=Path, help="summary.json of a simulation of the paper's protocol")
    parser.add_argument("--own-summary", type=Path, help="the same of a simulation on the own mesh")
    parser.add_argument("--only", nargs="+", metavar="CHECK", help="run these checks alone")
    parser.add_argument("--cache", type=Path, default=ROOT / "runs" / "validation", help="folder of kept simulations")
    parser.add_argument("--page", type=Path, default=ROOT / "docs" / "validation.md", help="page to write")
    options = parser.parse_args(arguments)
    sections = []
    for name, check in checks(options).items():
        began = time.perf_counter()
        section = check()
        sections.append(section)
        write_page(options.page, [section], order=TITLES)
        print(f"{name}: {time.perf_counter() - began:.1f} s", flush=True)
        for result in section.results:
            state = "met   " if result.met else "MISSED"
            print(f"  {state} {result.check}: {figure(result.value)} ({result.bar})", flush=True)
    print(json.dumps([result.json() for section in sections for result in section.results], ensure_ascii=False))


if __name__ == "__main__":
    main()
