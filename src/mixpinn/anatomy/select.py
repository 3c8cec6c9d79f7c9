"""Choosing structures: which is the body, which files of a folder are meant, each in one role."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from mixpinn.anatomy.bones import bones_among, choose_bones
from mixpinn.anatomy.images.image_file import label_files, structure_name
from mixpinn.anatomy.names import BODY_NAMES, tissue_group, unknown_structure
from mixpinn.base.errors import InputError


@dataclass(frozen=True)
class FolderSelection:
    """The files of a folder that an anatomy is made of.

    Attributes:
        body: the body's file.
        soft: file of each further soft tissue, by name.
        rigid: file of each rigid part, by name.
        targets: names of those that the crop follows.
    """

    body: Path
    soft: Mapping[str, Path]
    rigid: Mapping[str, Path]
    targets: tuple[str, ...] = ()

    def files(self) -> dict[str, Path]:
        """Every file by the name of its structure."""
        return {structure_name(self.body): self.body, **self.soft, **self.rigid}


def select_files(
    folder: Path | str, *, body: Path | str | None = None, rigid: Sequence[str] | None = None, soft: Sequence[str] = (),
    target: Sequence[str] | None = None, lumbar_only: bool = False, layers: bool = False,
) -> FolderSelection:
    """Choose the files of a folder; see `read_folder`.

    Raises:
        InputError: no such folder, no body, no rigid part, or a name that is not there.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(str(folder), expected="a folder with one NIfTI a structure", got="no such folder",
                         fix="check the path")
    found = label_files(folder)
    if not found:
        seen = sorted({"".join(path.suffixes[-2:]) or path.name for path in folder.iterdir()})
        raise InputError(
            str(folder), expected="label images (.nii.gz, .nrrd, .mha), one a structure",
            got=f"files of {', '.join(seen[:6])}" if seen else "an empty folder", fix="convert them, or check the path",
        )
    where = f"the folder {folder}"
    body_path = _body_file(folder, found, body)
    soft = with_layers(soft, found) if layers else soft
    rigid, targets = choose_bones(
        bones_among(found, soft), rigid=rigid, target=target, lumbar_only=lumbar_only,
        where=str(folder),
    )
    check_roles(structure_name(body_path), soft, rigid)
    for name in (*soft, *rigid):
        if name not in found:
            raise unknown_structure(name, found, where=where)
    return FolderSelection(
        body_path, {name: found[name] for name in soft}, {name: found[name] for name in rigid}, targets,
    )


def with_layers(soft: Sequence[str], names: Iterable[str]) -> tuple[str, ...]:
    """The named soft tissues and every fat, muscle and disc among `names`; single muscles where no whole is there."""
    groups = {name: tissue_group(name) for name in names if name not in soft}
    whole = [name for name, group in groups.items() if group == "muscle" and "muscle" in name.lower()]
    chosen = [
        name for name, group in groups.items()
        if group in ("fat", "disc") or (group == "muscle" and (not whole or name in whole))
    ]
    return (*soft, *sorted(chosen))


def find_body(names: Iterable[str]) -> list[str]:
    """Candidates for the body in any letters, best first; several where only ``body_trunc_*`` is there, or two."""
    names = sorted(names)
    trunks = [name for name in names if name.lower().startswith(BODY_NAMES[0] + "_")]
    for name in BODY_NAMES:
        if name in names:
            return [name]
        if alike := [other for other in names if other.lower() == name]:
            return alike
        if name == BODY_NAMES[0] and trunks:
            return trunks
    return []


def check_roles(body: str, soft: Sequence[str], rigid: Sequence[str]) -> None:
    """Check that there is a rigid part and that each structure is chosen once.

    Raises:
        InputError: otherwise, or where there are more structures than a label map can hold.
    """
    names = [body, *soft, *rigid]
    for name in names:
        if names.count(name) > 1:
            raise InputError(name, expected="each structure in one role", got="a structure chosen twice",
                             fix="name it once, as body, soft tissue or rigid part")
    if not rigid:
        raise InputError("rigid parts", expected="at least one", got="none", fix="name at least one structure")
    if len(names) > 255:
        raise InputError("structures", expected="at most 255", got=str(len(names)), fix="choose fewer")


def _body_file(folder: Path, found: Mapping[str, Path], body: Path | str | None) -> Path:
    if body is not None:
        if str(body) in found:
            return found[str(body)]
        if Path(body).is_file():
            return Path(body)
        raise unknown_structure(str(body), found, where=f"the folder {folder} or a file")
    candidates = find_body(found)
    if len(candidates) == 1:
        return found[candidates[0]]
    if candidates:
        raise InputError(str(folder), expected="one body", got=", ".join(candidates), fix="say which is the body")
    raise InputError(
        str(folder), expected="a body (" + ", ".join(f"{name}.nii.gz" for name in BODY_NAMES) + ")",
        got=f"only {', '.join(found)}",
        fix="add it (TotalSegmentator's task 'body') or name the body",
    )
