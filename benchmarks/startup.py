"""How fast the package starts: its import, and one ``mixpinn predict`` from the pose, beside another source tree.

``python -m benchmarks.startup BUNDLE --tip=x,y,z --other TREE`` prints both figures of this tree, their ratio to those
of the other one and, as its last line, a JSON object. Processor time is user and system time of the process; kernels
are compiled by a first run that does not count, and the two trees are measured in turn. A bundle whose files another
tree cannot read is given for that tree with ``--other-bundle``.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import median

from benchmarks.history import report

HERE = Path(__file__).parents[1]


def processor_seconds(tree: Path, words: Sequence[str]) -> float:
    """User and system time of ``python WORDS`` with the package of a source tree [s]."""
    environment = {**os.environ, "PYTHONPATH": str(tree / "src"), "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *words], env=environment, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def import_seconds(tree: Path, module: str) -> float:
    """Processor time of importing a module, less that of an interpreter that imports nothing [s]."""
    return processor_seconds(tree, ["-c", f"import {module}"]) - processor_seconds(tree, ["-c", ""])


def measure(trees: dict[str, tuple[Path, Path]], tip: str, rotation: float, repeats: int) -> dict[str, float]:
    """Median figures of each tree, given with its bundle."""
    with tempfile.TemporaryDirectory() as folder:
        words = {
            name: [
                "-m", "mixpinn.cli", "predict", str(bundle), f"--tip={tip}", f"--rotation={rotation}", "--out",
                f"{folder}/{name}.vtu",
            ] for name, (_, bundle) in trees.items()
        }
        for name, (tree, _) in trees.items():
            processor_seconds(tree, words[name])
        seconds: dict[str, list[float]] = {}
        for _ in range(repeats):
            for name, (tree, _) in trees.items():
                seconds.setdefault(f"predict_{name}", []).append(processor_seconds(tree, words[name]))
                seconds.setdefault(f"import_{name}", []).append(import_seconds(tree, "mixpinn"))
            seconds.setdefault("import_numpy", []).append(import_seconds(HERE, "numpy"))
    return {name: median(values) for name, values in seconds.items()}


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.startup", description=__doc__)
    parser.add_argument("bundle", type=Path)
    parser.add_argument("--tip", required=True)
    parser.add_argument("--rotation", type=float, default=0.0)
    parser.add_argument("--other", type=Path, help="another source tree to measure beside this one")
    parser.add_argument("--other-bundle", type=Path, help="the bundle that the other tree reads; the same by default")
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args(arguments)
    trees = {"here": (HERE, options.bundle.resolve())}
    if options.other is not None:
        trees["other"] = (options.other.resolve(), (options.other_bundle or options.bundle).resolve())
    found = measure(trees, options.tip, options.rotation, options.repeats)
    print(f"import mixpinn: {found['import_here']:.3f} s, import numpy: {found['import_numpy']:.3f} s")
    print(f"mixpinn predict: {found['predict_here']:.2f} s of processor time")
    if "predict_other" in found:
        found["predict_ratio"] = found["predict_other"] / found["predict_here"]
        print(f"the other tree: {found['predict_other']:.2f} s, {found['predict_ratio']:.1f} times as much")
    report("startup", {
        name if "ratio" in name else f"{name}_seconds": round(value, 4) for name, value in found.items()
    })


if __name__ == "__main__":
    main()
