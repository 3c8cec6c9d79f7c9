"""Stiffness of a press: how much it depends on the width of its differences, where contact does not switch.

``python -m benchmarks.stiffness BUNDLE`` takes `HybridPredictor.stiffness` at random presses over the back, straight
and from the history of the press itself, and central differences of half its width. The latter stand for the
derivative. Where a point of the skin begins or ends to touch between any of the poses the answer has a kink, and no
derivative; these presses are counted and left out. Matrices are compared with forces in N and moments in N times 20 mm,
shifts in mm and turns in 20 mm (an arm's length), by the Frobenius norm.

The last line is a JSON object: ``straight`` and ``remembered``, each with ``worst`` and ``median`` relative difference,
``within`` the share of presses within 3 %, ``presses`` compared and ``switching`` ones left out. Figures are of the
predictor against itself.
"""

import argparse
from pathlib import Path
from typing import Any
from unittest import mock

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
        if _switches(predictor, pose, history):
            switching += 1
            continue
        try:
            whole = _scaled(predictor.stiffness(pose.translation, rotation=pose.rotation, history=history))
            with (
                mock.patch.object(differences, "SHIFT", differences.SHIFT / 2.0),
                mock.patch.object(differences, "TURN", differences.TURN / 2.0),
            ):
                half = _scaled(predictor.stiffness(pose.translation, rotation=pose.rotation, history=history))
        except SolveError:
            unsolved += 1
            continue
        apart.append(float(np.linalg.norm(whole - half) / np.linalg.norm(half)))
    found = np.array(apart)
    return {
        "worst": float(found.max()), "median": float(np.median(found)), "within": float((found <= _WITHIN).mean()),
        "presses": len(found), "switching": switching, "unsolved": unsolved,
    }


def _scaled(matrix: FloatArray) -> FloatArray:
    """With moments and turns by the arm."""
    scale = np.repeat([1.0, 1.0 / _ARM], 3)
    return scale[:, None] * matrix * scale


def _switches(predictor: HybridPredictor, pose: ProbePose, history: object | None) -> bool:
    """Whether other points touch at the ends of the differences than at the pose itself."""
    touching = None
    for k in range(13):
        place, turn = pose.translation.copy(), pose.rotation
        if 0 < k <= 6:
            place[(k - 1) // 2] += differences.SHIFT * (-1) ** k
        elif k:
            vector = np.zeros(3)
            vector[(k - 7) // 2] = differences.TURN * (-1) ** k
            turn = rotation_from_vector(vector) @ turn
        after: Any = predictor.press(place, rotation=turn, history=history).history
        points = frozenset(zip(after.probe.tolist(), after.point.tolist(), strict=True))
        if touching is not None and points != touching:
            return True
        touching = points
    return False


if __name__ == "__main__":
    main()
