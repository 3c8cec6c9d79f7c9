"""``python -m benchmarks.results``: write docs/results.md, its pictures and the README's figures from finished runs.

Every figure on the page is read from what a command has stored; none is typed. Each section keeps its figures in
``docs/results/NAME.json`` and shows all of them in ``docs/results/NAME.md``; the page has the most important ones. A
section whose run is not given is rendered from what an earlier command kept.
"""

import argparse
from functools import partial
from pathlib import Path

from benchmarks.results.bundles import BUNDLES
from benchmarks.results.experiments import EXPERIMENTS
from benchmarks.results.full_scale import FULL_SCALE
from benchmarks.results.gpu import GPU
from benchmarks.results.hybrid import HYBRID
from benchmarks.results.hybrid import short as hybrid_short
from benchmarks.results.pipeline_run import DEMO, PATIENT1, PATIENT1_LINEAR, short, timing
from benchmarks.results.profile import PROFILE
from benchmarks.results.protocol import OWN_PROTOCOL, PROTOCOL
from benchmarks.results.section import Section, full_text, page_text, store, stored
from benchmarks.results.speed import SPEED
from benchmarks.results.truth import TRUTH
from mixpinn.base.files import write_text
from mixpinn.base.rundir import is_finished

ROOT = Path(__file__).parents[2]
SECTIONS: tuple[Section, ...] = (
    TRUTH, BUNDLES, PATIENT1, PATIENT1_LINEAR, DEMO, HYBRID, EXPERIMENTS, FULL_SCALE, GPU, PROFILE, PROTOCOL,
    OWN_PROTOCOL, SPEED,
)
"""In the order of the page."""
EFFECTS = "anatomy-effects"
"""Page that ``benchmarks.anatomy_effects`` writes by itself."""


KINDS = (
    "**What the errors are measured against.** There are two kinds of figure, and no table mixes them. *Against its "
    "own solver*: how well a model has learned the simulations that it was given. *Against the converged solution*: "
    "how far it is from what finer meshes and better elements end at, which is what a statement about a patient needs. "
    "All errors on this page but those of the first section are of the first kind. The solver's own discretisation is "
    "stiffer than the converged solution by far more than most errors below.\n"
)


def fill_readme(path: Path, sections: dict[str, str]) -> None:
    """Replace what stands between the README's markers ``<!-- figures: NAME -->`` and ``<!-- end: NAME -->``."""
    text = path.read_text()
    for name, section in sections.items():
        begin, end = f"<!-- figures: {name} -->", f"<!-- end: {name} -->"
        if begin not in text or end not in text:
            continue
        before, _, rest = text.partition(begin)
        _, _, after = rest.partition(end)
        text = f"{before}{begin}\n{section}\n{end}{after}"
    write_text(path, text)


def page(folder: Path) -> str:
    """The page from the stored figures of every section."""
    kept = {section: stored(folder, section) for section in SECTIONS}
    machines = dict.fromkeys(data["machine"] for data in kept.values() if data is not None)
    shown = {section: data for section, data in kept.items() if data is not None}
    return "\n".join([
        "# Results\n",
        f"Written by `python -m benchmarks.results` from finished runs. Machine: {'; '.join(machines)}, no GPU but "
        "where one is named. Errors are in millimetres, over the samples of probe positions that no model has seen.\n",
        KINDS,
        *(page_text(section, data, folder.name) for section, data in shown.items()),
        f"What joints, supports and layers do to force and motions: [tables]({folder.name}/{EFFECTS}.md).\n"
        "```{toctree}\n:hidden:\n\n" + "".join(f"{folder.name}/{section.name}\n" for section in shown)
        + f"{folder.name}/{EFFECTS}\n```\n",
    ])


def main(arguments: list[str] | None = None) -> None:
    """Collect what is given, then write the page."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.results", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    for section in SECTIONS:
        parser.add_argument(
            f"--{section.name}", metavar=section.metavar, help=section.help,
            type=str if section.several else Path, action="append" if section.several else "store",
        )
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "results.md")
    parser.add_argument("--readme", type=Path, default=ROOT / "README.md")
    options = parser.parse_args(arguments)
    folder, images = options.out.with_suffix(""), options.out.parent / "images"
    for section in SECTIONS:
        given = getattr(options, section.name.replace("-", "_"))
        if given is None and section.default is not None and is_finished(section.default):
            given = section.default
        if given is not None:
            store(folder, section, given, images)
    for section in SECTIONS:
        data = stored(folder, section)
        if data is not None:
            write_text(folder / f"{section.name}.md", full_text(section, data))
    write_text(options.out, page(folder))
    shown = {DEMO: partial(timing, command="make demo"), PATIENT1: partial(short, command="make patient1"),
             HYBRID: hybrid_short}
    figures = {section: stored(folder, section) for section in shown}
    fill_readme(options.readme, {
        section.name: shown[section](data) for section, data in figures.items() if data is not None
    })
    print(options.out)


if __name__ == "__main__":
    main()
