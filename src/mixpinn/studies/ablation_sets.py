"""Test sets of the table: the standard test split, and the hold-outs that the paper does not have."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mixpinn.base.arrays import BoolArray
from mixpinn.base.files import write_text
from mixpinn.base.validated import load_record, save_record
from mixpinn.dataset import Split, build_sample_table, with_contact_noise
from mixpinn.geometry.probe_shapes import linear_probe
from mixpinn.records import MESH_FILE, SampleTable, TissueMesh
from mixpinn.stages.simulation import SimulationConfig, make_simulations
from mixpinn.studies.ablation_config import AblationConfig, OtherProbe
from mixpinn.studies.ablation_jobs import REMAKE, SAMPLES, SETS


@dataclass(frozen=True)
class TestSet:
    """A set of test samples.

    Attributes:
        name: of its split.
        description: what about it no model has seen.
        positions, poses, samples: how many.
    """

    __test__ = False  # no test class, whatever its name says

    name: str
    description: str
    positions: int
    poses: int
    samples: int


@dataclass(frozen=True)
class _Sets:
    """What ``sets.json`` holds."""

    sets: tuple[TestSet, ...]


def seen_in_training(table: SampleTable, config: AblationConfig) -> BoolArray:
    """Whether rotation and depth of each sample may be trained on, shape (N,)."""
    seen = np.ones(len(table), dtype=bool)
    for rotation in config.unseen_rotations:
        seen &= ~np.isclose(table.rotation_deg, rotation)
    if config.deepest_seen is not None:
        seen &= table.depth <= config.deepest_seen
    return seen


def count_poses(table: SampleTable) -> int:
    """Number of poses that have a sample."""
    return len(np.unique(np.column_stack([table.position_index, np.round(table.rotation_deg * 1000.0)]), axis=0))


def _subset(table: SampleTable, positions: np.ndarray, mask: BoolArray) -> SampleTable:
    return table.select(np.isin(table.position_index, positions) & mask)


def own_sets(table: SampleTable, split: Split, config: AblationConfig) -> dict[str, tuple[str, SampleTable]]:
    """Test sets from the table's own samples: name to description and samples; empty ones are left out."""
    seen = seen_in_training(table, config)
    shallow = np.ones(len(table), dtype=bool) if config.deepest_seen is None else table.depth <= config.deepest_seen
    turned = np.zeros(len(table), dtype=bool)
    for rotation in config.unseen_rotations:
        turned |= np.isclose(table.rotation_deg, rotation)
    unseen = np.concatenate([split.validation, split.test])
    angles = "-".join(f"{rotation:g}" for rotation in config.unseen_rotations)
    test = _subset(table, split.test, seen)
    sets = {
        "test": ("positions never trained on", test),
        f"rotation-{angles}": (
            f"rotations never trained on ({angles.replace('-', ', ')}°), at the test and validation positions",
            _subset(table, unseen, turned & shallow),
        ),
        "deep": (
            f"depths never trained on (beyond {config.deepest_seen or 0:g} mm), at the test positions, rotations "
            "that were trained on", _subset(table, split.test, ~shallow & ~turned),
        ),
        "noise": (
            f"the samples of “test” with a normal error of {config.noise:g} mm in each component of each contact "
            "displacement", with_contact_noise(test, deviation=config.noise, seed=config.split.seed),
        ),
    }
    return {name: (text, samples) for name, (text, samples) in sets.items() if len(samples)}


def probe_set(
    mesh: TissueMesh, simulation: SimulationConfig, config: AblationConfig, probe: OtherProbe, positions: np.ndarray, *,
    out: Path, scheduler: str | None,
) -> tuple[str, SampleTable]:
    """Simulate the other probe at `positions` [mm], shape (p, 3), into the run directory `out`; its samples."""
    surface = out.parent / "other-probe"
    if not (surface / "probe.stl").exists():
        linear_probe(length=probe.length, width=probe.width, radius=min(5.0, 0.4 * probe.width)).save(
            surface / "probe.stl",
        )
        write_text(surface / "positions.txt", "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in positions.tolist()))
    pressed = replace(
        simulation, probe=str(surface / "probe.stl"), positions=str(surface / "positions.txt"),
        protocol=replace(simulation.protocol, rotations=probe.rotations),
    )
    store, _ = make_simulations(mesh, pressed, out=out, scheduler=scheduler)
    samples = build_sample_table(store, contact=config.split.contact_rule)
    shallow = np.ones(len(samples), dtype=bool) if config.deepest_seen is None else samples.depth <= config.deepest_seen
    angles = ", ".join(f"{rotation:g}" for rotation in probe.rotations)
    return (
        f"a probe never trained on ({probe.length:g} × {probe.width:g} mm), at the test positions, rotations {angles}°",
        samples.select(shallow),
    )


def save_sets(
    folder: Path, mesh: TissueMesh, sets: dict[str, tuple[str, SampleTable]], *, train: SampleTable,
    validation: SampleTable,
) -> None:
    """Write training, validation and test samples for the workers, the list of test sets last."""
    mesh.save(folder / SAMPLES / MESH_FILE)
    for name, samples in {"train": train, "validation": validation, **{k: v[1] for k, v in sets.items()}}.items():
        samples.save(folder / SAMPLES / name)
    described = [
        TestSet(name, text, len(np.unique(samples.position_index)), count_poses(samples), len(samples))
        for name, (text, samples) in sets.items()
    ]
    save_record(folder / SAMPLES / SETS, _Sets(tuple(described)))


def load_sets(folder: Path) -> tuple[TestSet, ...]:
    """The test sets of a table, described.

    Raises:
        InputError: absent or damaged.
    """
    return load_record(_Sets, folder / SAMPLES / SETS, remake=REMAKE).sets
