"""The anatomy stage: from a source of label maps to a checked label map in the world frame."""

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Literal, TypedDict

import numpy as np

from mixpinn.anatomy.bones import one_sacrum
from mixpinn.anatomy.checks.labels import check
from mixpinn.anatomy.checks.plausible import check_plausible
from mixpinn.anatomy.crop import CROP_ABOVE, CROP_BELOW, crop, place_in_frame
from mixpinn.anatomy.finding import ACCEPTABLE, Finding, require_sound
from mixpinn.anatomy.layers import THINNEST, add_layers, layers_of_ct, split_layers
from mixpinn.anatomy.phantom import PhantomConfig, phantom_segmentation
from mixpinn.anatomy.picture import draw_label_map
from mixpinn.anatomy.read import read_folder, read_multilabel
from mixpinn.anatomy.repair import repair
from mixpinn.anatomy.segmentation import Segmentation
from mixpinn.anatomy.select import select_files
from mixpinn.base.errors import InputError
from mixpinn.base.files import write_json
from mixpinn.base.rundir import RECORD, finish_run, is_finished, run_scope, start_run
from mixpinn.base.validated import load_record
from mixpinn.records.label_map import LabelMap, label_map_files

LABELS_FILE, FINDINGS_FILE, PICTURE_FILE = "labels.nii.gz", "findings.json", "labels.png"


@dataclass(frozen=True)
class AnatomyConfig:
    """Where an anatomy comes from and what is made of it.

    Attributes:
        source: "folder" (one image a structure), "multilabel" (one image) or "phantom".
        path: the folder or file.
        names: name table of a multi-label image, or ``total`` or ``total-v1``; by default the names in the image's
            header, and without them TotalSegmentator's task "total".
        body: name of the body, or a file; by default found by name.
        rigid: names of the rigid parts; by default every bone of the maps that lies inside the crop.
        target: rigid parts that the crop and the probe positions follow; by default the lumbar vertebrae.
        paper_parts: of the bones only the lumbar vertebrae are rigid, as in the paper; the others are soft tissue.
        soft: names of further soft tissues.
        layers: take every tissue of fat, muscle or disc that lies among the maps as a soft tissue.
        ct: the CT that the maps were made of, from which fat and muscle are taken by windows of HU.
        thinnest: layers of fat and muscle from this thickness on are kept [mm]; thinner ones are homogenised.
        crop_above, crop_below: margins of the crop about the targets [mm].
        repair: whether to mend what the label check finds.
        accept: kinds of finding that rest on what is usual and are refused otherwise, taken as warnings: ``affine``,
            ``scale``, ``direction``, ``numbering``, ``cut off``.
        phantom: dimensions of the phantom.
        seed: of the phantom's variation; without it the phantom is exactly as configured.
    """

    source: Literal["folder", "multilabel", "phantom"] = "phantom"
    path: str | None = None
    names: str | None = None
    body: str | None = None
    rigid: tuple[str, ...] | None = None
    target: tuple[str, ...] | None = None
    paper_parts: bool = False
    soft: tuple[str, ...] = ()
    layers: bool = False
    ct: str | None = None
    thinnest: float = THINNEST
    crop_above: float = CROP_ABOVE
    crop_below: float = CROP_BELOW
    repair: bool = False
    accept: tuple[str, ...] = ()
    phantom: PhantomConfig = field(default_factory=PhantomConfig)
    seed: int | None = None

    def __post_init__(self) -> None:
        unknown = sorted(set(self.accept) - set(ACCEPTABLE))
        if unknown:
            raise InputError(
                "accept", expected="some of " + ", ".join(ACCEPTABLE), got=unknown[0], fix="correct the setting",
            )
        margins = ("crop_above", self.crop_above), ("crop_below", self.crop_below), ("thinnest", self.thinnest)
        for name, value in margins:
            if not 0.0 <= value < np.inf:
                raise InputError(name, expected="0 mm or more", got=f"{value:g}", fix="correct the setting")


def source_settings(source: Path | str) -> dict[str, str | None]:
    """The settings of `AnatomyConfig` that say what `source` is.

    Args:
        source: ``phantom``, a folder of NIfTIs, or one multi-label NIfTI.
    """
    if str(source) == "phantom":
        return {"source": "phantom", "path": None}
    return {"source": "folder" if Path(source).is_dir() else "multilabel", "path": str(source)}


@dataclass(frozen=True, eq=False)
class AnatomyResult:
    """What the stage makes.

    Attributes:
        label_map: the anatomy.
        findings: of the label check; after a repair what was mended and what is left.
    """

    label_map: LabelMap
    findings: tuple[Finding, ...]


@run_scope()
def make_anatomy(config: AnatomyConfig, *, out: Path | str | None = None) -> AnatomyResult:
    """Read or build an anatomy, crop it, check it, repair it on request, and place it in the world frame.

    Args:
        config: source and settings.
        out: run directory for ``labels.nii.gz`` and ``.json``, ``findings.json`` and ``labels.png``; nothing is
            written without it, nor when the input is bad. A finished run of the same inputs is loaded.

    Raises:
        InputError: the input is not usable, or has errors that were not repaired.
    """
    inputs = _inputs(config)
    if out is None:
        return _compute(config)
    out = Path(out)
    if (out / RECORD).exists():
        start_run(out, "anatomy", config, inputs=inputs, seed=config.seed)
        if is_finished(out):
            with contextlib.suppress(InputError):  # a file that has since been lost or damaged is made anew
                return _load(out)
        result = _compute(config)
    else:
        result = _compute(config)
        start_run(out, "anatomy", config, inputs=inputs, seed=config.seed)
    result.label_map.save(out / LABELS_FILE)
    write_json(out / FINDINGS_FILE, [asdict(finding) for finding in result.findings])
    label_map_files(out / LABELS_FILE).seal_more(out, [FINDINGS_FILE])
    draw_label_map(result.label_map, out / PICTURE_FILE, findings=result.findings)
    finish_run(out, _summary(result))
    return result


def _load(out: Path) -> AnatomyResult:
    files = label_map_files(out / LABELS_FILE)
    if files.lists(out, FINDINGS_FILE):  # an older version did not list them
        files.check(out, FINDINGS_FILE)
    findings = load_record(tuple[Finding, ...], out / FINDINGS_FILE, remake="run 'mixpinn anatomy' again")
    return AnatomyResult(LabelMap.load(out / LABELS_FILE), findings)


def _path(config: AnatomyConfig) -> str:
    if config.path is None:
        raise InputError("path", expected=f"the path of the {config.source}", got="none", fix="give it")
    return config.path


def _inputs(config: AnatomyConfig) -> Mapping[str, Path | str]:
    """The files that the result depends on, by structure."""
    if config.source == "folder":
        files: dict[str, Path | str] = {**select_files(_path(config), **_roles(config)).files()}
        return files | ({"ct": config.ct} if config.ct is not None else {})
    if config.source == "multilabel":
        given = {"labels": _path(config), "names": config.names, "body": config.body, "ct": config.ct}
        return {key: path for key, path in given.items() if path is not None and Path(path).is_file()}
    return {}


class _Roles(TypedDict):
    body: str | None
    rigid: tuple[str, ...] | None
    soft: tuple[str, ...]
    target: tuple[str, ...] | None
    lumbar_only: bool
    layers: bool


def _roles(config: AnatomyConfig) -> _Roles:
    """Which structure plays which role, as the readers take it."""
    return {
        "body": config.body, "rigid": config.rigid, "soft": config.soft, "target": config.target,
        "lumbar_only": config.paper_parts, "layers": config.layers,
    }


def _read(config: AnatomyConfig) -> Segmentation:
    if config.source == "folder":
        return read_folder(_path(config), **_roles(config))
    if config.source == "multilabel":
        return read_multilabel(_path(config), names=config.names, **_roles(config))
    return phantom_segmentation(
        config.phantom, rng=None if config.seed is None else np.random.default_rng(config.seed),
    )


def _compute(config: AnatomyConfig) -> AnatomyResult:
    source, layers = split_layers(_read(config))
    require_sound(source.notes, accept=config.accept)
    segmentation = crop(one_sacrum(source), above=config.crop_above, below=config.crop_below)
    doubts = check_plausible(segmentation)
    require_sound([finding for finding in doubts if finding.kind == "scale"], accept=config.accept)
    findings = (*segmentation.notes, *doubts, *check(segmentation))
    if config.repair:
        mended, repairs = repair(segmentation)
        # Islands may have widened the crop: it is taken anew, and what is left is looked for in what is kept.
        segmentation = crop(mended, above=config.crop_above, below=config.crop_below)
        left = (*segmentation.notes, *check_plausible(segmentation), *check(segmentation))
        findings = (*repairs, *left, *_hidden(findings, left))
    require_sound(findings, accept=config.accept)
    built = config.source == "phantom"  # a built body fills its grid: nothing has cut it off
    lasting = tuple(
        finding.doubt for finding in findings if finding.lasting and not (built and finding.kind == "cut off")
    )
    segmentation = add_layers(segmentation, layers, thinnest=config.thinnest)
    if config.ct is not None:
        segmentation = layers_of_ct(segmentation, config.ct, thinnest=config.thinnest)
    findings = (*findings, *(note for note in segmentation.notes if note.kind == "layer"))
    label_map = replace(place_in_frame(segmentation), doubts=lasting, phantom=built)
    return AnatomyResult(label_map, findings)


def _hidden(before: Sequence[Finding], after: Sequence[Finding]) -> Iterator[Finding]:
    """What a repair does not mend and yet hides: half a vertebra at the image's end stays half a vertebra."""
    seen = {(finding.kind, finding.structure) for finding in after}
    for finding in before:
        if finding.kind in ("cut off", "size") and (finding.kind, finding.structure) not in seen:
            yield finding


def _summary(result: AnatomyResult) -> dict[str, object]:
    label_map = result.label_map
    counts = np.bincount(label_map.labels.ravel(), minlength=len(label_map.names) + 1)
    return {
        "hash": label_map.hash(), "shape": label_map.labels.shape,
        "voxels": {name: int(counts[label]) for label, name in enumerate(label_map.names, start=1)},
        "findings": [str(finding) for finding in result.findings],
    }
