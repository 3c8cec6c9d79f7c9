"""SOFA out: a complete SofaPython3 scene of the same set-up, for whoever has SOFA."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path

import jinja2
import numpy as np

from mixpinn.base.arrays import FloatArray, IntArray
from mixpinn.base.checksum import with_checksum
from mixpinn.base.errors import InputError
from mixpinn.base.files import atomic_path, write_json, write_text
from mixpinn.records import Probe, ProbePath, TissueMesh

TEMPLATE = "sofa_scene.py.j2"


@dataclass(frozen=True)
class SofaSettings:
    """What the scene needs besides geometry and paths; units mm, N, MPa, tonne, second.

    The material is SOFA's ``StableNeoHookean``, W = μ/2 (I_C − 3) + (λ + μ)/2 (J − α)², whose parameter set is
    (μ, λ). The defaults are the constants that the paper's scene passes.

    Attributes:
        mu, lam: μ and λ of each soft tissue [MPa], one entry for all or one for each.
        gap: SOFA's contact distance [mm].
        alarm: SOFA's alarm distance [mm].
        friction: Coulomb coefficient.
        density: [tonne/mm³].
        time_step: [s]; with 1 mm a step it sets how much inertia counts.
        hold_frames: frames for which the probe is held after each step; the last one is recorded. 0 records the
            transient, as the paper does.
        constraint_tolerance, constraint_iterations: of the constraint solver.
        rayleigh_stiffness, rayleigh_mass: damping [s], [1/s].
    """

    mu: tuple[float, ...] = (8.758621e-3,)
    lam: tuple[float, ...] = (84.666667e-3,)
    gap: float = 2.0
    alarm: float = 4.0
    friction: float = 1.0
    density: float = 1.0e-9
    time_step: float = 0.05
    hold_frames: int = 0
    constraint_tolerance: float = 1e-6
    constraint_iterations: int = 1000
    rayleigh_stiffness: float = 0.0
    rayleigh_mass: float = 0.0


def export_sofa_scene(
    folder: Path | str, mesh: TissueMesh, probe: Probe, paths: Mapping[tuple[int, float], ProbePath], *,
    settings: SofaSettings | None = None, skin_faces: IntArray | None = None,
) -> Path:
    """Write a folder that SOFA runs as it stands::

        scene.py          the scene, documented part by part; also the command line that records poses
        parameters.json   all numbers of `SofaSettings`, names of the parts
        geometry.npz      nodes, cells, parts, fixed nodes, skin triangles, probe: what the scene reads
        paths.npz         the probe's pose at each step of each pose
        body.vtu, probe.stl   the same geometry for viewers

    Its recordings have the layout that `import_sofa` reads.

    Args:
        folder: where to write.
        mesh: soft tissue and rigid parts.
        probe: the rigid tool.
        paths: path of each pose by (position index, rotation [degree]); all of one length.
        settings: constants.
        skin_faces: triangles of mesh nodes that can be touched, shape (t, 3); by default the skin within reach of
            the paths, since SOFA's collision detection slows down with every triangle.

    Returns:
        Path of the scene.

    Raises:
        InputError: no path, paths of different lengths, constants that do not fit the mesh's tissues, or quadratic
            cells.
    """
    if mesh.order != 1:
        raise InputError(
            "mesh", expected="linear cells, as the SOFA scene has them", got="quadratic ones",
            fix="export mesh.with_order(1)",
        )
    folder, settings = Path(folder), settings or SofaSettings()
    steps = {len(path) for path in paths.values()}
    tissues = len(mesh.tissue_names)
    if len(steps) != 1:
        raise InputError(
            str(folder), expected="probe paths of one length", got=f"lengths {sorted(steps)}",
            fix="export one protocol",
        )
    if {len(settings.mu), len(settings.lam)} - {1, tissues} or len(settings.mu) != len(settings.lam):
        raise InputError(
            "mu, lam", expected=f"1 or {tissues} values each", got=f"{len(settings.mu)} and {len(settings.lam)}",
            fix="give one for each soft tissue",
        )
    faces = reachable_faces(mesh, probe, paths) if skin_faces is None else np.asarray(skin_faces)
    write_json(folder / "parameters.json", with_checksum({
        **asdict(settings), "mu": list(settings.mu) * (tissues // len(settings.mu)),
        "lam": list(settings.lam) * (tissues // len(settings.lam)),
        "rigid_names": list(mesh.rigid_names), "tissue_names": list(mesh.tissue_names), "mesh_hash": mesh.hash(),
        "probe_name": probe.name, "units": "mm, N, MPa, tonne, s",
    }))
    with atomic_path(folder / "geometry.npz") as temporary:
        np.savez_compressed(
            temporary, points=mesh.points, cells=mesh.cells, part=mesh.part, fixed=mesh.fixed, tissue=mesh.tissue,
            skin_faces=faces, probe_points=probe.points, probe_triangles=probe.triangles,
        )
    order = sorted(paths)
    with atomic_path(folder / "paths.npz") as temporary:
        np.savez_compressed(
            temporary, position_index=np.array([key[0] for key in order]),
            rotation_deg=np.array([key[1] for key in order]),
            translations=np.stack([paths[key].translations for key in order]),
            rotations=np.stack([paths[key].rotations for key in order]),
            depths=np.stack([paths[key].depths for key in order]),
        )
    mesh.save(folder / "body.vtu")
    probe.save(folder / "probe.stl")
    scene = folder / "scene.py"
    write_text(scene, render_scene(mesh, poses=len(order), steps=steps.pop()))
    return scene


def render_scene(mesh: TissueMesh, *, poses: int, steps: int) -> str:
    """Text of ``scene.py``."""
    source = resources.files("mixpinn.interop").joinpath(TEMPLATE).read_text(encoding="utf-8")
    template = jinja2.Environment(undefined=jinja2.StrictUndefined, keep_trailing_newline=True).from_string(source)
    return template.render(
        nodes=mesh.n_points, cells=len(mesh.cells), parts=", ".join(mesh.rigid_names) or "none", poses=poses,
        steps=steps,
    )


def reachable_faces(
    mesh: TissueMesh, probe: Probe, paths: Mapping[tuple[int, float], ProbePath], *, margin: float = 20.0,
) -> IntArray:
    """Skin triangles that face the probe and lie within its reach plus `margin` [mm] of any path, shape (t, 3)."""
    reach = float(np.linalg.norm(probe.points, axis=1).max()) + margin
    faces = mesh.skin_faces
    corners = mesh.points[faces]
    centres: FloatArray = corners.mean(axis=1)
    near = np.zeros(len(faces), dtype=bool)
    for path in paths.values():
        span = path.translations[-1] - path.translations[0]
        length = max(float(np.linalg.norm(span)), 1e-12)
        along = np.clip((centres - path.translations[0]) @ span / length**2, 0.0, 1.0)
        distance = np.linalg.norm(centres - path.translations[0] - along[:, None] * span, axis=1)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        near |= (distance < reach) & (normals @ span < 0.0)
    return faces[near]
