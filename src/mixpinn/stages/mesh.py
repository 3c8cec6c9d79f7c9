"""The stage: label map, surfaces or ready mesh in; labelled mesh, its table, quality, fidelity and picture out."""

import contextlib
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Literal, TypeVar

from mixpinn.anatomy.images.image_file import IMAGE_SUFFIXES
from mixpinn.base.errors import InputError
from mixpinn.base.files import write_json, write_text
from mixpinn.base.manifest import Artefact
from mixpinn.base.progress import console, progress_bar
from mixpinn.base.rundir import finish_run, is_finished, run_scope, start_run
from mixpinn.base.sensible import positive, require_settings
from mixpinn.base.validated import load_record
from mixpinn.mesh.cells.bisect import refine_to
from mixpinn.mesh.cells.label import label_mesh
from mixpinn.mesh.cells.tissues import tissue_table
from mixpinn.mesh.checks.condition import check_unit, frame_warnings, mesh_warnings, numbering_warnings
from mixpinn.mesh.checks.ears import peel_flat_ears
from mixpinn.mesh.checks.fidelity import MeshFidelity, mesh_fidelity
from mixpinn.mesh.checks.quality import MeshQuality, mesh_quality
from mixpinn.mesh.checks.statistics import MeshStatistics, mesh_statistics
from mixpinn.mesh.import_vtu import import_vtu
from mixpinn.mesh.joint_frames import joint_frames, neighbours
from mixpinn.mesh.joint_picture import draw_joint_frames
from mixpinn.mesh.meshers.cgal_mesher import CgalMesher
from mixpinn.mesh.meshers.grading import Grading, SizingField
from mixpinn.mesh.meshers.mesher import Mesher, Sizing, has_cgal
from mixpinn.mesh.meshers.tetwild_mesher import TetwildMesher
from mixpinn.mesh.picture import draw_mesh
from mixpinn.mesh.surfaces.check_surface import check_surfaces
from mixpinn.mesh.surfaces.extract import SurfaceConfig, extract_surfaces
from mixpinn.mesh.surfaces.surface import DomainSurfaces
from mixpinn.records.joint_frame import JOINTS_FILE, JointFrame, save_joint_frames
from mixpinn.records.label_map import LabelMap, sidecar
from mixpinn.records.tissue_mesh import MESH_FILE, TissueMesh
from mixpinn.stages.anatomy import LABELS_FILE

T = TypeVar("T")
MESH_RUN = Artefact("mesh", 1, "run 'mixpinn mesh' into another folder")
MESH_RUN_FILES = (MESH_FILE, "statistics.json", "quality.json", "fidelity.json", "statistics.md", JOINTS_FILE)

_FINEST, _COARSEST = 0.02, 100.0
"""Sizes beyond which one is taken for a slip: a mesh has some fifty thousand nodes over the cube of it."""
_LONGEST = 1.6
"""Longest edges of a mesh over the length that the mesher was asked for: longer ones are halved."""


@dataclass(frozen=True)
class MeshConfig:
    """How a mesh is made.

    Attributes:
        mesher: CGAL, fTetWild, or CGAL where it is installed and else fTetWild.
        cells: ``graded`` by the lengths of `grading`, fine under the probe and round rigid parts, or ``uniform`` by the
            criteria of `sizing`, as the paper's mesh is.
        size: factor on the lengths of `grading` or `sizing`, and on nothing else: 2 is coarser, 0.5 finer.
        facets: factor on the lengths of `grading` that the surfaces are faceted with. By default it is `size`; a
            number gives the same facets at every smaller size, where cells are halved until their edges fit `size`.
        grading: edge lengths of graded cells at size 1.
        sizing: criteria of the mesher for uniform cells at size 1.
        surface: smoothing and gap, the same at every size.
        element: of the finite elements on the cells: ``linear`` tetrahedra with four nodes, or ``quadratic`` ones with
            ten, the midpoints of their edges among them.
        fixed: for an imported mesh, a file of the indices of fixed nodes.
        rigid_names: for an imported mesh, names of its rigid parts.
        part_array, soft_labels: for an imported mesh, other data that says the part, and what of it is soft tissue.
        picture: draw ``mesh.png``.
        timeout: of CGAL, which fails if it takes longer [s].
    """

    mesher: Literal["auto", "cgal", "tetwild"] = "auto"
    cells: Literal["graded", "uniform"] = "graded"
    size: float = 1.0
    facets: float | None = None
    grading: Grading = field(default_factory=Grading)
    sizing: Sizing = field(default_factory=Sizing)
    surface: SurfaceConfig = field(default_factory=SurfaceConfig)
    element: Literal["linear", "quadratic"] = "linear"
    fixed: str | None = None
    rigid_names: tuple[str, ...] | None = None
    part_array: str | None = None
    soft_labels: tuple[int, ...] = (0,)
    picture: bool = True
    timeout: float = 7200.0

    def __post_init__(self) -> None:
        require_settings(self, "mesh", {
            "size": (_FINEST <= self.size <= _COARSEST, f"a positive number, from {_FINEST:g} to {_COARSEST:g}"),
            **positive(self, "timeout"),
        })
        if self.facets is not None and self.cells != "graded":
            raise InputError(
                "facets", expected="graded cells", got=f"cells = {self.cells!r}", fix="leave one of the two out",
            )
        if self.facets is not None and not self.facets >= self.size:
            raise InputError(
                "facets", expected=f"a factor of at least size = {self.size:g}", got=f"{self.facets:g}",
                fix="cells cannot be coarser than the facets: choose larger facets or a smaller size",
            )


PAPER_CELLS = MeshConfig(cells="uniform")
"""The criteria of the paper's mesh, the same everywhere."""

PATIENT_CELLS = MeshConfig(element="quadratic", size=2.0, grading=Grading(fixed=6.0, elsewhere=15.0))
"""What a predictor for a patient is made on by default.

Measured on patient1 (``docs/results/truth.md``): linear cells of size 1 press back 1.53 to 1.63 times as hard as
quadratic ones on the same mesh. Most of what quadratic cells of size 2 still miss of the force is missed under the
probe; `mixpinn.fem.LocalRefinement` makes cells finer there. Finer cells on all of the back cost more than they help: a
predictor keeps a compliance of all nodes of the probed skin, which grows with the square of their number (0.4 GB at
size 2, 0.9 GB at size 1.5). What they miss of the vertebrae's motion is missed along the border of the skin that is
held, where stresses are singular: cells are finer there, none is as long as `Grading` has them elsewhere, and poses are
corrected for what is left (`mixpinn.fem.solve.held_border`).
"""


@dataclass(frozen=True, eq=False)
class MeshResult:
    """A mesh and what was measured on it; `fidelity` is absent for imported meshes and handed-in surfaces."""

    mesh: TissueMesh
    statistics: MeshStatistics
    quality: MeshQuality
    fidelity: MeshFidelity | None

    @staticmethod
    def load(folder: Path | str) -> "MeshResult":
        """Read a finished run directory.

        Raises:
            InputError: absent or damaged.
        """
        folder = Path(folder)
        MESH_RUN.check(folder)
        fidelity = folder / "fidelity.json"
        return MeshResult(
            TissueMesh.load(folder / MESH_FILE),
            load_record(MeshStatistics, folder / "statistics.json", remake=MESH_RUN.remake),
            load_record(MeshQuality, folder / "quality.json", remake=MESH_RUN.remake),
            load_record(MeshFidelity, fidelity, remake=MESH_RUN.remake) if fidelity.exists() else None,
        )


def load_mesh(source: Path | str) -> TissueMesh:
    """The mesh of a run directory of `make_mesh`, or of a ``.vtu`` that `TissueMesh.save` wrote.

    Raises:
        InputError: absent, damaged or altered.
    """
    source = Path(source)
    if source.suffix == ".vtu":
        return TissueMesh.load(source)
    if source.is_dir() and not ((source / MESH_FILE).exists() or MESH_RUN.is_sealed(source)):
        raise InputError(
            str(source), expected="the folder of a mesh", got=f"one without {MESH_FILE}",
            fix="run 'mixpinn mesh' first",
        )
    MESH_RUN.check(source, MESH_FILE)
    return TissueMesh.load(source / MESH_FILE)


def open_source(source: Path | str) -> LabelMap | Path:
    """The label map of a folder or file that the anatomy stage wrote; any other file is taken for a ready mesh.

    Raises:
        InputError: label images that have not been through the anatomy stage, or a damaged label map.
    """
    source = Path(source)
    image = source / LABELS_FILE if source.is_dir() else source
    is_image = source.is_dir() or source.name.lower().endswith((*IMAGE_SUFFIXES, ".dcm"))
    if not is_image or not source.exists():
        return source
    if not sidecar(image).is_file():
        raise InputError(
            str(source), expected="an anatomy that 'mixpinn anatomy' wrote",
            got="label images that it has not checked and placed",
            fix=f"run 'mixpinn anatomy {source} --out ANATOMY' first, then 'mixpinn mesh ANATOMY'",
        )
    return LabelMap.load(image)


def make_mesher(name: Literal["auto", "cgal", "tetwild"], *, timeout: float = MeshConfig.timeout) -> Mesher:
    """The mesher called `name`; ``auto`` is CGAL where it is installed, else fTetWild."""
    if name == "cgal" or (name == "auto" and has_cgal()):
        return CgalMesher(timeout=timeout)
    return TetwildMesher()


@run_scope()
def make_mesh(
    source: LabelMap | DomainSurfaces | Path | str, config: MeshConfig | None = None, *, out: Path | str | None = None,
) -> MeshResult:
    """Mesh a label map or closed surfaces, or import a ready mesh.

    Args:
        source: a label map, closed surfaces, or the path of a mesh that `import_vtu` reads.
        config: criteria and mesher.
        out: run directory for ``mesh.vtu``, ``statistics.json``, ``statistics.md``, ``quality.json``,
            ``fidelity.json`` and ``mesh.png``; a finished run there is loaded instead of made again.

    Raises:
        InputError: the source cannot be meshed, or `out` holds another run.
    """
    config = config or MeshConfig()
    if out is None:
        return _measure(*_build(source, config))
    out, settings = Path(out), asdict(config)
    del settings["timeout"]  # decides when
    if isinstance(source, Path | str):
        inputs = {"mesh": Path(source)} | ({"fixed": Path(config.fixed)} if config.fixed else {})
        if not Path(source).is_file():
            raise InputError(str(source), expected="a mesh (.vtu)", got="no such file", fix="check the path")
        begun = start_run(out, "mesh", settings, inputs=inputs)
    else:
        begun = start_run(out, "mesh", settings, input_hashes={"source": source.hash()})
    if begun and is_finished(out):
        return MeshResult.load(out)
    result = _measure(*_build(source, config))
    result.mesh.save(out / MESH_FILE)
    write_json(out / "statistics.json", result.statistics)
    write_json(out / "quality.json", result.quality)
    report = result.statistics.markdown()
    if result.mesh.doubts:
        report += "\n" + "".join(f"- {doubt}\n" for doubt in result.mesh.doubts)
    if isinstance(source, LabelMap):
        report += tissue_table(result.mesh, source)
    if result.fidelity is not None:
        write_json(out / "fidelity.json", result.fidelity)
        report += "\n" + result.fidelity.markdown()
    write_text(out / "statistics.md", report)
    if isinstance(source, LabelMap) and not source.phantom:
        frames: list[JointFrame] = []
        for pair in neighbours(result.mesh):
            with contextlib.suppress(InputError):  # no end plates, no frame: a scene that wants it says so
                frames += joint_frames(result.mesh, between=[pair])
        save_joint_frames(frames, out / JOINTS_FILE)
        if config.picture and frames:
            draw_joint_frames(result.mesh, frames, out / "joints.png")
    MESH_RUN.seal(out, [name for name in MESH_RUN_FILES if (out / name).is_file()])
    if config.picture:
        try:
            draw_mesh(result.mesh, out / "mesh.png")
        except InputError as error:  # a mesh without its picture is still a mesh
            console.print(f"no picture: {error}")
    finish_run(out, {
        "points": result.mesh.n_points, "hash": result.mesh.hash(), "quality": asdict(result.quality),
        "warnings": result.mesh.doubts,
    })
    return result


def _build(source: LabelMap | DomainSurfaces | Path | str, config: MeshConfig) -> tuple[TissueMesh, LabelMap | None]:
    mesh, label_map = _cells(source, config)
    thin = () if label_map is None else tuple(
        f"{name}: part: soft tissue, since it is too thin for smoothing and gaps of the surfaces"
        for name in label_map.rigid_names if name not in mesh.rigid_names
    )
    for line in thin:
        console.print(line, soft_wrap=True)
    odd = mesh_warnings(mesh)
    if isinstance(source, Path | str):
        odd = (*odd, *frame_warnings(mesh), *(numbering_warnings(mesh) if config.fixed else ()))
        for line in odd:
            console.print(f"[yellow]warning[/]: {line}", soft_wrap=True)
    doubts = (*mesh.doubts, *thin, *(f"mesh: {line}" for line in odd))
    mesh = replace(mesh, doubts=tuple(dict.fromkeys(doubts)))
    return mesh.with_order(2 if config.element == "quadratic" else mesh.order), label_map


def _cells(source: LabelMap | DomainSurfaces | Path | str, config: MeshConfig) -> tuple[TissueMesh, LabelMap | None]:
    if isinstance(source, Path | str):
        mesh = import_vtu(
            source, fixed=config.fixed, rigid_names=config.rigid_names, part_array=config.part_array,
            soft_labels=config.soft_labels,
        )
        check_unit(mesh, what=str(source))
        return mesh, None
    label_map = source if isinstance(source, LabelMap) else None
    mesher = make_mesher(config.mesher, timeout=config.timeout)
    if isinstance(source, LabelMap):
        surfaces = _announce("surfaces", lambda: extract_surfaces(source, config.surface))
    else:
        surfaces = _announce("check of the surfaces", lambda: check_surfaces(source))
    facets = config.size if config.facets is None else config.facets
    sizing = config.grading.scaled(facets) if config.cells == "graded" else config.sizing.scaled(facets)
    points, cells = _announce(f"tetrahedra ({mesher.name})", lambda: mesher.fill(surfaces, sizing))
    mesh = peel_flat_ears(label_mesh(points, cells, surfaces, label_map=label_map))
    if config.size < facets:
        wanted = SizingField(surfaces, config.grading.scaled(config.size))
        mesh = _announce("finer cells", lambda: refine_to(mesh, lambda at: _LONGEST * wanted(at)))
    return mesh, label_map


def _measure(mesh: TissueMesh, label_map: LabelMap | None) -> MeshResult:
    fidelity = None
    if label_map is not None:
        fidelity = _announce("comparison with the label map", lambda: mesh_fidelity(mesh, label_map))
    return MeshResult(mesh, mesh_statistics(mesh), mesh_quality(mesh), fidelity)


def _announce(step: str, work: Callable[[], T]) -> T:
    """Do `work` behind a bar that shows the step and the time it takes; libraries give no finer progress."""
    with progress_bar() as bar:
        task = bar.add_task(step, total=None)
        result = work()
        bar.update(task, total=1, completed=1)
    return result
