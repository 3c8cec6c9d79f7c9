"""Stiffness of a press: how much it depends on the width of its differences, where contact does not switch.

``python -m benchmarks.stiffness BUNDLE`` takes `HybridPredictor.stiffness` at random presses over the back, straight
and from the history of the press itself, and central differences of half its width. The latter stand for the
derivative. Where a point of the skin begins or ends to touch, or to slide, between the poses the answer has a kink and
no derivative: other points touch at the ends than in the middle, or the differences to both sides are apart by more
than 5 %. These presses are counted and left out. Matrices are compared with forces in N and moments in N times 20 mm,
shifts in mm and turns in 20 mm (an arm's length), by the Frobenius norm.

The last line is a JSON object: ``straight`` and ``remembered``, each with ``worst`` and ``median`` relative difference,
``within`` the share of presses within 3 %, ``presses`` compared, ``switching`` and ``unsolved`` ones left out. Figures
are of the predictor against itself.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

import mixpinn.serving.stiffness as differences
from benchmarks.history import report
from mixpinn.base.arrays import FloatArray
from mixpinn.base.errors import SolveError
from mixpinn.geometry.probe_pose import ProbePose
from mixpinn.geometry.rotations import rotation_from_vector
from mixpinn.serving import HybridPredictor, load_predictor
from mixpinn.serving.live import SkinPlacement

_ARM = 20.0
_WITHIN = 0.03
_KINK = 0.05 / 2.0
"""Half of how far the differences to both sides may be apart, relative to their sum."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bundle", type=Path)
    parser.add_argument("--presses", type=int, default=40)
    args = parser.parse_args()
    predictor = load_predictor(args.bundle)
    if not isinstance(predictor, HybridPredictor):
        raise SystemExit("a hybrid bundle is needed")
    report("stiffness", {
        name: _compare(predictor, args.presses, remembered=name == "remembered") for name in ("straight", "remembered")
    })


def _compare(predictor: HybridPredictor, presses: int, *, remembered: bool) -> dict[str, Any]:
    domain, skin = predictor.pressing.domain, SkinPlacement(predictor.pressing)
    above, rng = float(predictor.mesh.points[:, 1].max()), np.random.default_rng(0)
    apart: list[float] = []
    switching = unsolved = 0
    for _ in range(presses):
        x, z = rng.uniform(domain.low, domain.high)
        depth, turn = rng.uniform(3.0, domain.deepest), rng.uniform(0.0, 180.0)
        pose = skin.place((x, above, z), depth=depth, turn_deg=turn)
        history = predictor.press(pose.translation, rotation=pose.rotation).history if remembered else None
        try:
            whole = _scaled(predictor.stiffness(pose.translation, rotation=pose.rotation, history=history))
        except SolveError:
            unsolved += 1
            continue
        _, smooth = _differences(predictor, pose, history)
        half, smoother = _differences(predictor, pose, history, share=0.5)
        if smooth and smoother:
            apart.append(float(np.linalg.norm(whole - half) / np.linalg.norm(half)))
        else:
            switching += 1
    found = np.array(apart)
    return {
        "worst": float(found.max()), "median": float(np.median(found)), "within": float((found <= _WITHIN).mean()),
        "presses": len(found), "switching": switching, "unsolved": unsolved,
    }


def _scaled(matrix: FloatArray) -> FloatArray:
    """With moments and turns by the arm."""
    scale = np.repeat([1.0, 1.0 / _ARM], 3)
    return scale[:, None] * matrix * scale


def _differences(
    predictor: HybridPredictor, pose: ProbePose, history: object | None, *, share: float = 1.0,
) -> tuple[FloatArray, bool]:
    """Central differences of a share of the width, scaled, and whether contact stays as it is between the poses."""
    shift, turn = share * differences.SHIFT, share * differences.TURN
    answers = [predictor.press(pose.translation, rotation=pose.rotation, history=history)]
    for k in range(6):
        for sign in (1.0, -1.0):
            step = np.zeros(6)
            step[k] = sign * (shift if k < 3 else turn)
            answers.append(predictor.press(
                pose.translation + step[:3], rotation=rotation_from_vector(step[3:]) @ pose.rotation, history=history,
            ))
    histories: list[Any] = [answer.history for answer in answers]
    touching = {frozenset(zip(one.probe.tolist(), one.point.tolist(), strict=True)) for one in histories}
    wrenches = np.array([np.concatenate([answer.force, answer.moment]) for answer in answers])
    width = np.repeat([shift, turn], 3)[:, None]
    after, before = (_scaled(((side - wrenches[0]) / width).T) for side in (wrenches[1::2], wrenches[2::2]))
    bent = np.linalg.norm(after + before) > _KINK * np.linalg.norm(after - before)
    return 0.5 * (after - before), len(touching) == 1 and not bent


if __name__ == "__main__":
    main()
