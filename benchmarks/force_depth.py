"""Pressing to a force: how many poses are solved for it, and how far the force is off.

``python -m benchmarks.force_depth BUNDLE`` asks at random places over the back for forces from 2 N to 90 % of what the
pose reaches at the learned depth, and for some beyond it, which must be refused with the range. The last line is a JSON
object: ``within`` the share of answers within 0.1 N, ``solves_mean``, ``solves_max``, ``off_max_n``, ``refused`` the
share of forces beyond reach that were refused, ``poses``. Figures are of the predictor against itself.
"""

import argparse
from pathlib import Path

import numpy as np

from benchmarks.history import report
from mixpinn.base.errors import InputError
from mixpinn.geometry.probe_pose import probe_rotation
from mixpinn.serving import HybridPredictor, load_predictor
from mixpinn.serving.live import SkinPlacement


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bundle", type=Path)
    parser.add_argument("--poses", type=int, default=200)
    args = parser.parse_args()
    predictor = load_predictor(args.bundle)
    if not isinstance(predictor, HybridPredictor):
        raise SystemExit("a hybrid bundle is needed")
    domain, skin = predictor.pressing.domain, SkinPlacement(predictor.pressing)
    rng = np.random.default_rng(0)
    above = float(predictor.mesh.points[:, 1].max())
    solves, off, refused, asked = [], [], 0, 0
    while len(solves) < args.poses:
        x, z = rng.uniform(domain.low, domain.high)
        turn = float(rng.uniform(0.0, 180.0))
        most = skin.place((x, above, z), depth=domain.deepest, turn_deg=turn)
        reach = float(np.linalg.norm(predictor.press(most.translation, rotation=most.rotation).force))
        if 0.9 * reach <= 2.0:
            continue  # beside the rigid parts the flank yields to less
        wanted = float(rng.uniform(2.0, 0.9 * reach))
        found = predictor.depth_for(wanted, most.translation, rotation=probe_rotation(turn))
        solves.append(found.solves)
        off.append(abs(found.force - wanted))
        if len(solves) % 10 == 0:
            asked += 1
            try:
                predictor.depth_for(1.05 * reach, most.translation, rotation=most.rotation)
            except InputError as error:
                refused += "0 to" in str(error)
    report("force_depth", {
        "within": float(np.mean(np.array(off) <= 0.1)), "solves_mean": float(np.mean(solves)),
        "solves_max": int(np.max(solves)), "off_max_n": float(np.max(off)), "refused": refused / max(asked, 1),
        "poses": len(solves),
    })


if __name__ == "__main__":
    main()
