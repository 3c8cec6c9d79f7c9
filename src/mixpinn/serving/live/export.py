"""Save what a session answered: numbers as a table, deformed meshes as a time series that ParaView opens."""

import csv
import io
import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from mixpinn.base.errors import InputError
from mixpinn.base.files import atomic_path
from mixpinn.records.tissue_mesh import TissueMesh
from mixpinn.records.vtu import vtu_text
from mixpinn.serving.live.records import LiveAnswer

_POSE = [f"{name}_{axis}" for name in ("tip", "force", "moment") for axis in "xyz"]
_TURN = [f"r{i}{j}" for i in range(3) for j in range(3)]


def save_table(frames: Iterable[LiveAnswer], path: Path | str, *, mesh: TissueMesh) -> None:
    """One line an answer and probe: time, pose, force, trust, motions of the rigid parts (``.csv``).

    Args:
        frames: answers.
        path: of the file.
        mesh: of the session, whose rigid parts name the columns.

    Raises:
        InputError: the folder cannot be written.
    """
    names = [part.replace(",", " ") for part in mesh.rigid_names]
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow([
            "time_s", "sequence", "pose_id", "probe", "depth_mm", *_POSE, *_TURN, "expected_mm", "bound_mm",
            "force_bound_n", "outside", "converged", "solve_ms",
            *(f"{name} {column}" for name in names for column in ("x_mm", "y_mm", "z_mm", "angle_deg")), "notes",
        ])
        for frame in frames:
            table.writerows(_rows(frame, mesh))


def save_series(frames: Iterable[LiveAnswer], path: Path | str) -> None:
    """Deformed meshes over time: a ``.pvd`` that ParaView opens, with a folder of ``.vtu``; or both in a ``.zip``.

    Args:
        frames: answers; each becomes a file.
        path: of the ``.pvd`` or ``.zip``.

    Raises:
        InputError: another suffix, no answers, or the folder cannot be written.
    """
    path = Path(path)
    if path.suffix not in (".pvd", ".zip"):
        raise InputError(str(path), expected=".pvd or .zip", got=path.suffix or "no suffix", fix="rename the output")
    folder, times = f"{path.stem}_frames", []
    if path.suffix == ".zip":
        packed = zipfile.ZIP_DEFLATED
        with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w", packed, compresslevel=1) as archive:
            for name, time, text in _files(frames, folder):
                archive.writestr(name, text)
                times.append((name, time))
            archive.writestr(f"{path.stem}.pvd", _index(times, path))
        return
    for name, time, text in _files(frames, folder):
        with atomic_path(path.parent / name) as temporary:
            temporary.write_text(text, encoding="ascii")
        times.append((name, time))
    with atomic_path(path) as temporary:
        temporary.write_text(_index(times, path), encoding="utf-8")


def _files(frames: Iterable[LiveAnswer], folder: str) -> Iterator[tuple[str, float, str]]:
    for index, frame in enumerate(frames):
        answer = frame.answer
        yield f"{folder}/{index:05d}.vtu", frame.time, vtu_text(answer.mesh.tetra_grid(answer.displacement).vtk())


def _index(times: list[tuple[str, float]], path: Path) -> str:
    if not times:
        raise InputError(str(path), expected="at least one answer", got="none", fix="record a session first")
    out = io.StringIO()
    out.write('<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n')
    out.write("  <Collection>\n")
    for name, time in times:
        out.write(f'    <DataSet timestep="{time:.6f}" part="0" file={quoteattr(name)}/>\n')
    out.write("  </Collection>\n</VTKFile>\n")
    return out.getvalue()


def _rows(frame: LiveAnswer, mesh: TissueMesh) -> Iterator[list[object]]:
    answer, trust = frame.answer, frame.answer.trust
    motions: list[object] = []
    for name in mesh.rigid_names:
        motion = answer.motions[name]
        motions += [*np.round(motion.translation, 6).tolist(), round(motion.angle_deg, 6)]
    judged: list[object] = [""] * 5
    if trust is not None:
        judged = [
            "" if value is None else f"{value:.6g}" for value in (trust.expected, trust.bound, trust.force_bound)
        ] + [int(trust.outside), int(trust.converged)]
    notes = "; ".join(answer.warnings())
    for row, probe in enumerate(frame.probes):
        force, moment = (
            np.full(3, np.nan) if values is None else values.reshape(-1, 3)[row]
            for values in (answer.force, answer.moment)
        )
        yield [
            f"{frame.time:.6f}", frame.sequence, probe.pose_id, probe.index, f"{probe.depth:.6f}",
            *(f"{value:.6f}" for value in (*probe.pose.translation, *force, *moment)),
            *(f"{value:.9f}" for value in probe.pose.rotation.ravel()), *judged, f"{1e3 * frame.seconds:.3f}",
            *motions, notes,
        ]
