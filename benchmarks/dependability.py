"""Whether answers from the probe's pose can be leaned on: random presses, poses beyond sense, several threads.

``python -m benchmarks.dependability BUNDLE`` presses at random places over the bones, with any rotation and a tilt of
up to 15°, from first touch down in steps of 0.25 mm, each answer asked for on its own, and prints as its last line a
JSON object:

- ``answers``; ``answered``: share of them that is neither refused nor flagged; ``unconverged``: answers delivered as
  good although contact did not converge; ``absurd``: a force above three times both neighbours'; ``jumps``: more than
  1.5 N and three times the median step of the press; ``dips``: a normal force that falls by more than 0.1 N;
- ``nonsense`` and ``nonsense_passed``: poses beyond sense (60 and 100 mm deep, upside down, from the belly, far away,
  not a number), and those of them that were answered without a word;
- ``thread_differences``: answers of several threads that differ from those of one;
- ``bound_coverage``, ``bound_sharpness``: share of unseen samples whose errors (field, force, motion) keep their
  bounds, and the median bound relative to the median error; ``pose_mee``, ``pose_mee_max``: on these samples;
  ``flagged``: how many of them are answered with a warning, and ``sound_pose_mee``, ``sound_pose_mee_max`` without
  these. They need the store that the bundle was made from (beside it, or ``--store``).

``--confirm`` repeats each jump and dip with the full solver (``confirmed_jumps``, ``confirmed_dips``).
"""

import argparse
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.history import report

if TYPE_CHECKING:
    from mixpinn.press.model import PoseModel, PosePrediction
    from mixpinn.records import SampleTable, TissueMesh

_parser = argparse.ArgumentParser(prog="python -m benchmarks.dependability", description=__doc__)
_parser.add_argument("bundle", type=Path)
_parser.add_argument("--presses", type=int, default=40)
_parser.add_argument("--seed", type=int, default=0)
_parser.add_argument("--threads", type=int, default=4)
_parser.add_argument("--thread-answers", type=int, default=1000, help="of each thread")
_parser.add_argument("--store", type=Path, help="simulations with poses that the bundle has not seen")
_parser.add_argument("--confirm", action="store_true", help="repeat jumps and dips with the full solver")
_parser.add_argument("--verbose", action="store_true", help="list every jump and dip")

DEEPEST, STEP, TILT = 20.0, 0.25, 15.0
JUMP, DIP = 1.5, 0.1


@dataclass(frozen=True, eq=False)
class Press:
    """A straight press: rotation (3, 3), tip at first touch (3,), depths (s,) [mm]."""

    rotation: np.ndarray
    touch: np.ndarray
    depths: np.ndarray

    def tips(self) -> np.ndarray:
        """Tip at each depth, shape (s, 3)."""
        return self.touch - self.depths[:, None] * self.rotation[:, 1]


def random_presses(model: "PoseModel", count: int, rng: np.random.Generator) -> list[Press]:
    """Presses over the bones of the model's mesh; those that miss the skin are drawn again."""
    from mixpinn.base.errors import InputError
    from mixpinn.geometry.first_touch import first_touch
    from mixpinn.geometry.probe_pose import probe_rotation

    mesh, field = model.hybrid.mesh, model.probes[0]
    probe = field.probe
    bones = mesh.points[mesh.part > 0] if mesh.n_parts else mesh.points
    low, high, found = bones.min(axis=0), bones.max(axis=0), []
    while len(found) < count:
        place = rng.uniform(low, high)
        place[1] = mesh.points[:, 1].max()
        tilt, towards = np.deg2rad(rng.uniform(0.0, TILT)), rng.uniform(0.0, 2.0 * np.pi)
        direction = [np.sin(tilt) * np.cos(towards), -np.cos(tilt), np.sin(tilt) * np.sin(towards)]
        rotation = probe_rotation(rng.uniform(0.0, 360.0), direction)
        try:
            touch = first_touch(
                place, rotation, points=mesh.points, triangles=mesh.skin_faces, probe=probe, gap=field.gap,
            )
        except InputError:
            continue
        found.append(Press(rotation, touch, np.arange(0.0, DEEPEST + 1e-9, STEP)))
    return found


def follow(model: "PoseModel", press: Press) -> "list[PosePrediction | None]":
    """The answer at each depth, None where it was refused."""
    from mixpinn.base.errors import InputError

    found: list[PosePrediction | None] = []
    for tip in press.tips():
        try:
            found.append(model.predict(press.rotation[None], tip[None]))
        except InputError:
            found.append(None)
    return found


def faults(force: np.ndarray, push: np.ndarray) -> tuple[list[int], list[int], list[int]]:
    """Absurd answers, jumps (the later one of each pair) and dips along a press.

    Args:
        force: of the probe, shape (s, 3) [N].
        push: its part along the pressing direction, shape (s,) [N].
    """
    size = np.linalg.norm(force, axis=1)
    absurd = [i for i in range(1, len(size) - 1) if size[i] > 3.0 * max(size[i - 1], size[i + 1]) and size[i] > 1.0]
    moved = np.linalg.norm(np.diff(force, axis=0), axis=1)
    jumps = np.flatnonzero((moved > JUMP) & (moved > 3.0 * np.median(moved))) + 1
    dips = np.flatnonzero(np.diff(push) < -DIP) + 1
    return absurd, jumps.tolist(), dips.tolist()


def nonsense(model: "PoseModel", press: Press) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Poses that no answer could be given for, by name: rotation and tip."""
    mesh: TissueMesh = model.hybrid.mesh
    axis, turned = -press.rotation[:, 1], np.diag([1.0, -1.0, -1.0])
    belly = np.array([press.touch[0], mesh.points[:, 1].min() + 10.0, press.touch[2]])
    inside = np.array([press.touch[0], mesh.points[:, 1].mean(), press.touch[2]])
    return {
        "60 mm deep": (press.rotation, press.touch + 60.0 * axis),
        "100 mm deep": (press.rotation, press.touch + 100.0 * axis),
        "upside down": (press.rotation @ turned, press.touch + 5.0 * axis),
        "from the belly": (turned, belly), "beneath the belly": (np.eye(3), belly), "inside": (np.eye(3), inside),
        "far above": (press.rotation, press.touch - 500.0 * axis),
        "far beside": (press.rotation, press.touch + np.array([1000.0, 0.0, 0.0])),
        "not a number": (press.rotation, press.touch * np.nan),
        "no rotation": (press.rotation * np.nan, press.touch),
    }


def passed_nonsense(model: "PoseModel", press: Press) -> tuple[int, list[str]]:
    """How many poses beyond sense were asked, and which were answered without a word."""
    from mixpinn.base.errors import InputError

    poses, passed = nonsense(model, press), []
    for name, (rotation, tip) in poses.items():
        try:
            trust = model.predict(rotation[None], tip[None]).trust
        except InputError:
            continue
        if trust.sound and not trust.reasons:
            passed.append(name)
    return len(poses), passed


def thread_differences(model: "PoseModel", presses: list[Press], threads: int, answers: int) -> int:
    """Answers of `threads` threads at once, each in its own order, that differ from those of one."""
    poses = [(press.rotation[None], tip[None]) for press in presses for tip in press.tips()[4::8]]
    expected = [model.predict(*pose).displacement for pose in poses]
    wrong = np.zeros(threads, dtype=np.int64)

    def ask(which: int) -> None:
        order = np.random.default_rng(which).integers(len(poses), size=answers)
        for i in order:
            wrong[which] += not np.array_equal(model.predict(*poses[i]).displacement, expected[i])

    workers = [threading.Thread(target=ask, args=(which,)) for which in range(threads)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    return int(wrong.sum())


def bounds(model: "PoseModel", table: "SampleTable") -> dict[str, Any]:
    """Errors of unseen samples against the bounds that go with the answers."""
    from mixpinn.press.fit import pose_errors

    coordinates, errors, told, sound = model.hybrid.prior.coordinates, [], [], []
    for i in range(len(table)):
        found = model.predict(table.probe_rotation[i][None], table.probe_translation[i][None])
        trust = found.trust
        truth = coordinates.project(table.displacement[i])
        errors.append(pose_errors(coordinates, found.unknowns, found.wrench[0], truth, table.probe_wrench[i]))
        told.append([trust.bound, trust.force_bound, trust.motion_bound])
        sound.append(trust.sound)
    error, bound = np.array(errors), np.array(told, dtype=np.float64)
    names = ("field", "force", "motion")
    return {
        "samples": len(table), "flagged": len(sound) - sum(sound),
        "sound_pose_mee": float(error[sound, 0].mean()), "sound_pose_mee_max": float(error[sound, 0].max()),
        "pose_mee": float(error[:, 0].mean()), "pose_mee_max": float(error[:, 0].max()),
        "bound_coverage": dict(zip(names, (error <= bound).mean(axis=0).tolist(), strict=True)),
        "bound_sharpness": dict(
            zip(names, (np.median(bound, axis=0) / np.median(error, axis=0)).tolist(), strict=True),
        ),
    }


def unseen(bundle: Path, store: Path | None) -> "SampleTable | None":
    """Samples at the test positions of the bundle's split; None where the store is not at hand."""
    from mixpinn.dataset import SimulationStore, Split, build_sample_table

    folder = store or bundle.parent / "simulation" / "store"
    if not (folder / "store.json").is_file() or not (bundle / "split.json").is_file():
        return None
    return build_sample_table(SimulationStore.open(folder)).at_positions(Split.load(bundle / "split.json").test)


def confirmed(scene: Any, press: Press, at: list[int], *, dips: bool) -> int:
    """How many of the jumps or dips at these depths the full solver makes too."""
    from mixpinn.fem import simulate_pose
    from mixpinn.records import ProbePath

    depths = np.arange(1.0, np.ceil(press.depths[max(at)]))
    depths = np.unique(np.concatenate([depths, press.depths[[k for i in at for k in (i - 1, i)]]]))
    tips = press.touch - depths[:, None] * press.rotation[:, 1]
    path = ProbePath(tips, np.repeat(press.rotation[None], len(depths), axis=0), depths)
    force = simulate_pose(scene, path, position_index=0, rotation_deg=0.0).probe_wrench[:, :3]
    count = 0
    for i in at:
        before, after = (int(np.argmin(np.abs(depths - press.depths[k]))) for k in (i - 1, i))
        change = force[after] - force[before]
        count += bool(change @ press.rotation[:, 1] < 0.0 if dips else np.linalg.norm(change) > JUMP)
    return count


def full_scene(bundle: Path) -> Any:
    """The scene that the simulations of the bundle's own run were made with."""
    from mixpinn.dataset import SimulationStore
    from mixpinn.fem import Scene
    from mixpinn.geometry.probe_shapes import linear_probe

    store = SimulationStore.open(bundle.parent / "simulation" / "store")
    tied = store.restraints()
    return Scene(
        store.mesh(), store.probe() or linear_probe(), store.materials(), store.contact(), joints=tied.joints,
        foundations=tied.foundations, membrane=tied.membrane, refinement=store.refinement(),
    )


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """All figures of one bundle."""
    from mixpinn.records.answer import discretisation_of
    from mixpinn.serving import HybridPredictor

    model = HybridPredictor.load(options.bundle).pose
    assert model is not None, "the bundle takes no poses"
    presses = random_presses(model, options.presses, np.random.default_rng(options.seed))
    totals = dict.fromkeys(("answers", "answered", "unconverged", "absurd", "jumps", "dips"), 0)
    reasons: dict[str, int] = {}
    suspects = []
    for number, press in enumerate(presses):
        answers = follow(model, press)
        given = [answer for answer in answers if answer is not None]
        good = [answer.trust.sound and (depth <= 0.25 or not answer.trust.reasons) for answer, depth in
                zip(answers, press.depths, strict=True) if answer is not None]
        for answer in given:
            for reason in answer.trust.reasons:
                reasons[reason.split(";")[0]] = reasons.get(reason.split(";")[0], 0) + 1
        force = np.array([answer.wrench[0, :3] for answer in given])
        absurd, jumps, dips = faults(force, force @ press.rotation[:, 1])
        unconverged = sum(not a.contact.converged and a.trust.sound for a in given)
        for name, value in zip(
            totals, (len(answers), sum(good), unconverged, len(absurd), len(jumps), len(dips)), strict=True,
        ):
            totals[name] += value
        if jumps or dips:
            suspects.append((press, jumps, dips))
        if options.verbose and (absurd or jumps or dips):
            where = (press.depths[at] for at in (absurd, jumps, dips))
            print(f"press {number}: " + ", ".join(map("{} {}".format, ("absurd", "jumps", "dips"), where)))
    asked, passed = passed_nonsense(model, presses[0])
    if reasons:
        print("flags: " + ", ".join(f"{text} ({count})" for text, count in sorted(reasons.items())[:20]))
    result: dict[str, Any] = {**totals, "answered": totals["answered"] / totals["answers"]}
    result |= {"discretisation": discretisation_of(model.hybrid.mesh), "nonsense": asked, "nonsense_passed": passed}
    result["thread_differences"] = thread_differences(model, presses, options.threads, options.thread_answers)
    table = unseen(options.bundle, options.store)
    result |= {"bound_coverage": None, "bound_sharpness": None} if table is None else bounds(model, table)
    if options.confirm and suspects:
        scene = full_scene(options.bundle)
        result["confirmed_jumps"] = sum(confirmed(scene, p, jumps, dips=False) for p, jumps, _ in suspects if jumps)
        result["confirmed_dips"] = sum(confirmed(scene, p, dips, dips=True) for p, _, dips in suspects if dips)
    return result


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    report("dependability", measure(_parser.parse_args(arguments)))


if __name__ == "__main__":
    main()
