"""From the pose of the probe alone: errors against the full contact simulation, forces, vertebrae, latency.

``python -m benchmarks.pose STORE --hybrid FOLDER --pose FOLDER --split FILE`` evaluates a pose model, beside it the
same without what was learned about contact, contact on the linear body alone, and a ridge regression from the pose
without any contact. ``--fit`` first fits the model on the training positions of the split and saves it to the folder.
All samples of the chosen part of the split count. The last line is a JSON object. Errors of vertebrae are 95th
percentiles over samples and vertebrae; of forces, |f − f_true| / |f_true|.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.history import report
from mixpinn.dataset import SimulationStore, Split, build_sample_table
from mixpinn.press.contact import PriorContact
from mixpinn.press.domain import PoseDomain
from mixpinn.press.files import load_pose_model, save_pose_model
from mixpinn.press.fit import collect, fit_pose, fitted_bend
from mixpinn.press.model import PoseModel
from mixpinn.press.records import PoseContactConfig
from mixpinn.records import Probe, SampleTable
from mixpinn.reduced.coordinates import ReducedCoordinates
from mixpinn.reduced.hybrid import HybridModel
from mixpinn.reduced.modes import coefficients, principal_modes
from mixpinn.reduced.ridge import column_norms, ridge

Answer = Callable[[int], tuple[np.ndarray, np.ndarray]]
"""Sample → unknowns (D,) and force on the probe [N] (3,)."""


def score(answer: Answer, table: SampleTable, coordinates: ReducedCoordinates) -> dict[str, float]:
    """Errors of `answer` on all samples of `table`."""
    rigid = np.concatenate([part[:count] for part, count in zip(coordinates.parts, coordinates.vertices, strict=True)])
    mee, rigid_mee, shifts, turns, forces = [], [], [], [], []
    for i in range(len(table)):
        unknowns, force = answer(i)
        truth = table.displacement[i]
        error = np.linalg.norm(coordinates.expand(unknowns) - truth, axis=1)
        mee.append(error[: coordinates.n_vertices].mean())
        rigid_mee.append(error[rigid].mean())
        mine, true = coordinates.twists(unknowns), coordinates.twists(coordinates.project(truth))
        shifts.append(np.linalg.norm(mine[:, :3] - true[:, :3], axis=1))
        apart = Rotation.from_rotvec(mine[:, 3:]).inv() * Rotation.from_rotvec(true[:, 3:])
        turns.append(np.rad2deg(apart.magnitude()))
        wanted = table.probe_wrench[i, :3]
        forces.append(np.linalg.norm(force - wanted) / np.linalg.norm(wanted))
    return {
        "mee": float(np.mean(mee)), "mee_p95": float(np.percentile(mee, 95)), "mee_max": float(np.max(mee)),
        "rigid_mee": float(np.mean(rigid_mee)),
        "vertebra_translation_p95": float(np.percentile(shifts, 95)),
        "vertebra_rotation_p95_deg": float(np.percentile(turns, 95)),
        "force_error_mean": float(np.mean(forces)), "force_error_median": float(np.median(forces)),
        "force_error_p95": float(np.percentile(forces, 95)),
    }


def by_model(model: PoseModel, table: SampleTable) -> Answer:
    """What a pose model answers on the samples of a table."""
    def answer(i: int) -> tuple[np.ndarray, np.ndarray]:
        found = model.predict(table.probe_rotation[i][None], table.probe_translation[i][None])
        return found.unknowns, found.wrench[0, :3]

    return answer


def pose_features(table: SampleTable, index: np.ndarray) -> np.ndarray:
    """Cubic features of tip position, rotation about the axis and depth, for the regression without contact."""
    tip = table.probe_translation[index] / 50.0
    angle = np.deg2rad(table.rotation_deg[index])
    depth = table.depth[index] / 10.0
    plain = np.column_stack([tip, np.cos(2 * angle), np.sin(2 * angle), depth])
    first, second = np.triu_indices(plain.shape[1])
    square = plain[:, first] * plain[:, second]
    cube = (square[:, :, None] * plain[:, None, :]).reshape(len(index), -1)
    return np.concatenate([np.ones((len(index), 1)), plain, square, cube], axis=1)


def regression(table: SampleTable, training: np.ndarray, model: HybridModel) -> Answer:
    """From the pose straight to modes of the displacement and to the force; learned on `training` samples."""
    coordinates = model.prior.coordinates
    fields = np.array([coordinates.project(table.displacement[i]) for i in training], dtype=np.float32)
    modes = principal_modes(fields, coordinates.weights, 32, rng=np.random.default_rng(0))
    wanted = np.concatenate([
        coefficients(modes, coordinates.weights, fields), table.probe_wrench[training, :3],
    ], axis=1)
    known = pose_features(table, training)
    gain = ridge(known, wanted, penalty=1e-5, scale=column_norms(known))

    def answer(i: int) -> tuple[np.ndarray, np.ndarray]:
        found = (pose_features(table, np.array([i])) @ gain)[0]
        return found[: len(modes)].astype(np.float32) @ modes, found[len(modes):]

    return answer


def latency(model: PoseModel, table: SampleTable, repeats: int) -> dict[str, float]:
    """Wall time of one prediction of a random sample, warm [ms]."""
    order = np.random.default_rng(0).integers(len(table), size=repeats + 20)
    seconds = []
    for i in order:
        began = time.perf_counter()
        model.predict(table.probe_rotation[i][None], table.probe_translation[i][None])
        seconds.append(1e3 * (time.perf_counter() - began))
    return {
        "pose_latency_ms_p50": float(np.percentile(seconds[20:], 50)),
        "pose_latency_ms_p99": float(np.percentile(seconds[20:], 99)),
    }


def main() -> None:
    """Fit if asked, evaluate, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("store", type=Path)
    parser.add_argument("--hybrid", type=Path, required=True, help="folder of the hybrid model")
    parser.add_argument("--pose", type=Path, required=True, help="folder of the pose model")
    parser.add_argument("--split", type=Path, required=True)
    parser.add_argument("--part", choices=["validation", "test"], default="test")
    parser.add_argument("--fit", action="store_true", help="fit the pose model first")
    parser.add_argument("--every", type=int, default=1, help="fit on every so-many-th sample")
    parser.add_argument("--memory-map", type=Path, help="file for the samples' displacement")
    parser.add_argument("--repeats", type=int, default=200)
    parser.add_argument("--no-baselines", action="store_true")
    args = parser.parse_args()
    store = SimulationStore.open(args.store)
    split, mesh = Split.load(args.split), store.mesh()
    hybrid = HybridModel.load(args.hybrid, mesh)
    table = build_sample_table(store, memory_map=args.memory_map)
    training = np.flatnonzero(np.isin(table.position_index, split.train))[:: args.every]
    if args.fit:
        probe = Probe.load(args.store / "probe.stl")
        law = store.contact()
        config = PoseContactConfig.of_order(mesh.order, gap=law.gap, friction=law.friction)
        solver = PriorContact.of_prior(hybrid.prior, config)
        probes = (solver.field(probe),)
        model = PoseModel(hybrid, solver, probes, PoseDomain.of_mesh(mesh))
        began = time.perf_counter()
        validation = np.flatnonzero(np.isin(table.position_index, split.validation))[:: args.every]
        seen = np.union1d(training, validation)
        model = fitted_bend(model, table.select(seen))
        model = fit_pose(model, collect(model, table, seen))
        save_pose_model(model, args.pose)
        print(f"fitted on {len(training)} samples in {time.perf_counter() - began:.0f} s")
    model = load_pose_model(args.pose, hybrid)
    asked = table.at_positions(getattr(split, args.part))
    coordinates = hybrid.prior.coordinates

    def linear(i: int) -> tuple[np.ndarray, np.ndarray]:
        found = model.contact.solve(model.probes[:1], asked.probe_rotation[i][None], asked.probe_translation[i][None])
        if not len(found.nodes):
            return np.zeros(coordinates.size, dtype=np.float32), np.zeros(3)
        held = hybrid.prior.hold(found.nodes)
        return hybrid.prior.respond_to_forces(held, found.forces.ravel()), found.wrench[0, :3]

    rows = {"pose model": score(by_model(model, asked), asked, coordinates)}
    if not args.no_baselines:
        rows["without correction"] = score(by_model(replace(model, correction=None), asked), asked, coordinates)
        rows["contact on the linear body"] = score(linear, asked, coordinates)
        whole = regression(table, training, hybrid)
        where = np.flatnonzero(np.isin(table.position_index, getattr(split, args.part)))
        rows["regression from the pose"] = score(lambda i: whole(int(where[i])), asked, coordinates)
    for name, values in rows.items():
        print(f"{name:28s}" + "  ".join(f"{key} {value:.4f}" for key, value in values.items()))
    main_row = rows["pose model"]
    report("pose", {
        "pose_mee": main_row["mee"], "pose_mee_p95": main_row["mee_p95"], "pose_mee_max": main_row["mee_max"],
        "pose_rigid_mee": main_row["rigid_mee"],
        **{key: main_row[key] for key in (
            "vertebra_translation_p95", "vertebra_rotation_p95_deg", "force_error_mean", "force_error_median",
            "force_error_p95",
        )},
        **latency(model, asked, args.repeats), "samples": len(asked), "part": args.part,
        "baselines": {name: values for name, values in rows.items() if name != "pose model"},
    })


if __name__ == "__main__":
    main()
