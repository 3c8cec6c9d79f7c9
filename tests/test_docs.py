"""What README, site and docstrings show is run: Python as it stands, commands and settings as far as they are cheap."""

import doctest
import importlib
import re
import shlex
import shutil
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import nibabel as nib
import numpy as np
import pytest
import typer

import mixpinn
from mixpinn.anatomy.phantom import TINY_PHANTOM, phantom_segmentation
from mixpinn.base.config import build_config
from mixpinn.cli import app
from mixpinn.dataset import SimulationStore, build_sample_table
from mixpinn.pipeline import RunConfig
from mixpinn.records import TissueMesh
from mixpinn.stages.simulation import SimulationConfig
from pipeline.chain import chain, done  # noqa: F401 (a fixture)

ROOT = Path(__file__).parents[1]
SOURCES = ROOT / "src" / "mixpinn"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES = [page for page in PAGES if page.exists() and page.parent.name not in ("results", "gallery")]
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks(language: str) -> Iterator[tuple[Path, str]]:
    for page in PAGES:
        for found, text in FENCE.findall(page.read_text(encoding="utf-8")):
            if found == language:
                yield page, text


def named(items):
    return [pytest.param(*item, id=f"{item[0].stem}-{number}") for number, item in enumerate(items)]


@pytest.fixture(scope="module")
def world(chain, tmp_path_factory):  # noqa: F811
    """A folder with the runs that the pages speak of, at toy size."""
    folder = tmp_path_factory.mktemp("world")
    (folder / "runs" / "me").mkdir(parents=True)
    for name, source in {
        "me/anatomy": chain.anatomy, "me/mesh": chain.mesh, "me/simulation": chain.simulation,
        "me/mixpinn": chain.model, "model": chain.model,
    }.items():
        shutil.copytree(source, folder / "runs" / name)
    done(
        "train", folder / "runs/me/simulation", "--model", "hybrid", "--set", "hybrid.modes=6", "--set",
        "hybrid.coordinates=3", "--out", folder / "runs" / "me" / "hybrid",
    )
    for name in ("me/bundle", "hybrid"):
        shutil.copytree(folder / "runs" / "me" / "hybrid", folder / "runs" / name)
    (folder / "contacts.csv").write_text("node,dx,dy,dz\n5,0,-1,0\n")
    phantom = phantom_segmentation(replace(TINY_PHANTOM, vertebrae=3))
    (folder / "segmentations").mkdir()
    for structure in (phantom.body, *phantom.rigid):
        mask = structure.window((0, 0, 0), phantom.shape).astype(np.uint8)
        nib.save(nib.Nifti1Image(mask, phantom.affine), folder / "segmentations" / f"{structure.name}.nii.gz")
    return folder


@pytest.mark.parametrize("page", dict.fromkeys(page for page, _ in blocks("python")), ids=lambda page: page.stem)
def test_python_runs(page, world, monkeypatch):
    """A page's blocks, one after the other, at toy size: a later one may use the names of those before it."""
    monkeypatch.chdir(world)
    monkeypatch.setattr(mixpinn, "make_mesh", partial(mixpinn.make_mesh, size=5.0))
    monkeypatch.setattr(mixpinn.protocols, "SMALL", replace(mixpinn.protocols.SMALL, max_positions=5, steps=2))
    names = {"__name__": "snippet"}
    for owner, text in blocks("python"):
        if owner == page:
            exec(compile(text, str(page), "exec"), names)


def commands() -> Iterator[tuple[Path, str]]:
    """Every ``mixpinn …`` line of a bash block or of the running text, without comments."""
    for page, text in blocks("bash"):
        for line in text.replace("\\\n", " ").splitlines():
            if line.strip().startswith("mixpinn "):
                yield page, line.partition(" #")[0].strip()
    for page in PAGES:
        for line in re.findall(r"`(mixpinn [^`]*)`", page.read_text(encoding="utf-8").replace("\n", " ")):
            yield page, line


@pytest.mark.parametrize(("page", "line"), named(commands()))
def test_commands_parse(page, line):
    """Verb and options exist, and their values have the right kind; an ellipsis stands for what is left out."""
    words = [word for word in shlex.split(line)[1:] if word not in ("…", "...")]
    command = typer.main.get_command(app)
    context = None
    while hasattr(command, "commands") and words:
        context = command.make_context("mixpinn", [], parent=context, resilient_parsing=True)
        name = words.pop(0)
        if name in ("VERB", "--help"):
            return
        found = command.get_command(context, name)
        assert found is not None, f"{page.name}: no verb {name!r} in {line!r}"
        command = found
    options = {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
    for word in words:
        if word.startswith("--"):
            assert word.partition("=")[0] in options, f"{page.name}: no option {word} in {line!r}"
    if "…" not in line and "..." not in line:
        command.make_context(command.name, words, parent=context, resilient_parsing=True)


@pytest.mark.parametrize(("page", "text"), named(blocks("toml")))
def test_settings_are_accepted(page, text):
    values = tomllib.loads(text)
    kind = SimulationConfig if values.keys() <= {"tissue", "tissues", "protocol", "contact", "solver"} else RunConfig
    if kind is RunConfig or "tissues" not in values:
        build_config(kind, values)
    else:
        assert isinstance(build_config(kind, values).tissues, dict)


@pytest.mark.parametrize(("page", "module"), named(
    (page, module) for page in PAGES
    for module in sorted(set(re.findall(r"python -m ((?:benchmarks|validation)[\w.]*)", page.read_text())))
))
def test_modules_that_are_named_exist(page, module):
    path = ROOT / module.replace(".", "/")
    assert path.with_suffix(".py").exists() or (path / "__main__.py").exists(), f"{page.name}: python -m {module}"


def test_targets_that_are_named_exist():
    targets = set(re.findall(r"^([a-z0-9]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    named_targets = {
        target for page in PAGES
        for target in re.findall(r"[`\n]make ([a-z][a-z0-9]*)", page.read_text(encoding="utf-8"))
    }
    assert named_targets <= targets


def test_the_page_of_the_paper_points_to_what_is_there():
    text = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
    paths = re.findall(r"`((?:src|tests)/[\w/.]+)`", text)
    assert len(paths) > 30
    assert [path for path in paths if not (ROOT / path).exists()] == []
    for name in re.findall(r"`(mixpinn(?:\.\w+)+)`", text):
        module, _, attribute = name.rpartition(".")
        assert hasattr(importlib.import_module(module), attribute), name


def test_every_room_has_its_place_in_the_contract_and_on_the_page(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    architecture = importlib.import_module("architecture")
    rooms = {path.parent.name for path in SOURCES.glob("*/__init__.py")}
    assert rooms <= {room for layer in architecture.contract_layers() for room in layer}
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    assert [room for room in sorted(rooms) if f"`{room}`" not in page] == []
    arrows = {("a", "b"): 1, ("b", "c"): 2, ("a", "c"): 3}
    assert architecture.reduced(arrows) == {("a", "b"): 1, ("b", "c"): 2}  # a reaches c over b


def modules_with_examples() -> list[str]:
    return [
        ".".join(path.relative_to(SOURCES.parent).with_suffix("").parts).removesuffix(".__init__")
        for path in sorted(SOURCES.rglob("*.py")) if ">>>" in path.read_text(encoding="utf-8")
    ]


@pytest.fixture(scope="module")
def names(world):
    """What docstring examples may use without saying where it comes from."""
    store = SimulationStore.open(world / "runs" / "me" / "simulation" / "store")
    table = build_sample_table(store)
    return {
        "np": np, "mixpinn": mixpinn, "mesh": TissueMesh.load(world / "runs" / "me" / "mesh" / "mesh.vtu"),
        "store": store, "simulation": store.load(store.poses[0]), "table": table,
    }


@pytest.mark.parametrize("module", modules_with_examples())
def test_docstring_examples_run(module, world, names, monkeypatch):
    monkeypatch.chdir(world)
    imported = importlib.import_module(module)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    report: list[str] = []
    for test in doctest.DocTestFinder(recurse=True).find(imported, module, extraglobs=dict(names)):
        runner.run(test, out=report.append)
    assert runner.tries > 0
    assert runner.failures == 0, "".join(report)
