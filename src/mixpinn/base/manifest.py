"""The manifest of an artefact: its files with the size and the SHA-256 of each; written last, checked on reading.

An artefact is a folder, or a group of files in one: a bundle, a trained network, a mesh run, a store, an entry of the
cache. Its manifest is a JSON file beside them. A file that was altered, cut short or exchanged after the manifest was
written is refused before it is read, with what was expected and how to mend it. Hashing runs at 1 to 2 GB/s; a file is
hashed once a process as long as its size and time stamp stay.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mixpinn.base.checksum import with_checksum, without_checksum
from mixpinn.base.errors import InputError
from mixpinn.base.files import hash_file, read_json, write_json

MANIFEST = "manifest.json"
_checked: dict[tuple[str, int, int, int], str] = {}
"""Hashes of this process by path, inode, size and time of change."""


@dataclass(frozen=True)
class Artefact:
    """What a kind of artefact is called and how one is made again.

    Attributes:
        kind: ``hybrid bundle``, ``mesh``, …
        version: of the format.
        remake: what a user does where one is damaged or of an older version.
        manifest: name of the manifest.
    """

    kind: str
    version: int
    remake: str
    manifest: str = MANIFEST

    def seal(self, folder: Path | str, names: Sequence[str]) -> None:
        """Write the manifest of the files `names`, paths relative to `folder`; to be called after they were written."""
        folder = Path(folder)
        self._write(folder, {name: _proof(folder / name) for name in names})

    def seal_more(self, folder: Path | str, names: Sequence[str]) -> None:
        """Add files to a manifest that `seal` wrote; their former entries are replaced.

        Raises:
            InputError: no manifest, or one of another kind.
        """
        folder = Path(folder)
        self._write(folder, self._entries(folder) | {name: _proof(folder / name) for name in names})

    def is_sealed(self, folder: Path | str) -> bool:
        """Whether there is a manifest, good or bad."""
        return (Path(folder) / self.manifest).is_file()

    def lists(self, folder: Path | str, name: str) -> bool:
        """Whether the manifest lists the file `name`; errors as `check`."""
        return name in self._entries(Path(folder))

    def check(self, folder: Path | str, *names: str) -> None:
        """Compare files with the manifest; all that it lists where none is named.

        Raises:
            InputError: no manifest, one of another version, a file that it does not list, or one that was altered.
        """
        folder = Path(folder)
        entries = self._entries(folder)
        for name in names or entries:
            path = folder / name
            if name not in entries:
                raise InputError(
                    str(path), expected=f"a file of the {self.kind}'s manifest", got="one that it does not list",
                    fix=self.remake,
                )
            if not path.is_file():
                raise InputError(
                    str(path), expected=f"a file of the {self.kind}", got="no such file", fix=self.remake,
                )
            size, expected = path.stat().st_size, entries[name]
            if size != expected["size"]:
                raise InputError(
                    str(path), expected=f"{expected['size']} bytes",
                    got=f"{size}: the file was altered after it was made", fix=self.remake,
                )
            found = _hash_once(path)
            if found != expected["sha256"]:
                raise InputError(
                    str(path), expected=f"contents with SHA-256 {expected['sha256'][:12]}…",
                    got=f"{found[:12]}…: the file was altered after it was made", fix=self.remake,
                )

    def _write(self, folder: Path, files: dict[str, dict[str, Any]]) -> None:
        content = {"format": self.kind, "version": self.version, "files": files}
        write_json(folder / self.manifest, with_checksum(content))

    def _entries(self, folder: Path) -> dict[str, dict[str, Any]]:
        path = folder / self.manifest
        if not folder.is_dir():
            raise InputError(
                str(folder), expected=f"the folder of a {self.kind}", got="no such folder", fix="check the path",
            )
        if not path.is_file():
            raise InputError(
                str(path), expected=f"the manifest of a {self.kind}",
                got="none (an older version wrote this, or a command that was stopped)",
                fix=f"if you trust these files, add it with 'mixpinn seal {folder}'; else {self.remake}",
            )
        values = without_checksum(read_json(path), str(path), remake=self.remake)
        entries = values.get("files") if isinstance(values, dict) else None
        if not isinstance(entries, dict) or not all(
            isinstance(entry, dict) and isinstance(entry.get("size"), int) and isinstance(entry.get("sha256"), str)
            for entry in entries.values()
        ):
            raise InputError(
                str(path), expected=f"the manifest of a {self.kind}", got="another layout", fix=self.remake,
            )
        if (values.get("format"), values.get("version")) != (self.kind, self.version):
            raise InputError(
                str(path), expected=f"a {self.kind} of version {self.version}",
                got=f"a {values.get('format')} of version {values.get('version')}", fix=self.remake,
            )
        return entries


def refuse_sealed(path: Path) -> None:
    """Refuse to write over a file of an artefact, which would be damaged by it.

    Raises:
        InputError: a manifest beside `path` lists it.
    """
    for manifest in path.parent.glob(f"*{MANIFEST}"):
        try:
            values = read_json(manifest)
        except InputError:
            continue
        files = values.get("files") if isinstance(values, dict) else None
        if isinstance(files, dict) and path.name in files:
            raise InputError(
                str(path), expected="an output beside nothing that it damages",
                got=f"a file of a {values.get('format')}", fix="choose another name or folder for the output",
            )


def _proof(path: Path) -> dict[str, Any]:
    return {"size": path.stat().st_size, "sha256": hash_file(path)}


def _hash_once(path: Path) -> str:
    """SHA-256 of a file; one that has not changed since this process hashed it is not read again."""
    state = os.stat(path)
    key = (str(path.absolute()), state.st_ino, state.st_size, state.st_mtime_ns)
    if key not in _checked:
        _checked[key] = hash_file(path)
    return _checked[key]
