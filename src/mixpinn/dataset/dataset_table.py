"""Dataset table: positions, poses and samples of each part of a split, as in the paper."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from mixpinn.base.validated import load_record, save_record
from mixpinn.dataset.split import Split
from mixpinn.records import SampleTable

_Count = Annotated[int, Field(ge=0)]
_Counts = tuple[_Count, _Count, _Count, _Count]
COLUMNS = ("train", "validation", "test", "total")


@dataclass(frozen=True)
class DatasetTable:
    """Counts of train, validation, test and all.

    Attributes:
        split: name of the split.
        positions, poses, samples: four numbers each, for `COLUMNS`. A position or pose counts if it has a sample.
    """

    split: str
    positions: _Counts
    poses: _Counts
    samples: _Counts

    def markdown(self) -> str:
        """The table in Markdown."""
        rows = {"Probe position": self.positions, "Probe pose": self.poses, "Generated sample": self.samples}
        lines = ["| | Train | Validation | Test | Total |", "| --- | ---: | ---: | ---: | ---: |"]
        lines += [f"| {name} | " + " | ".join(f"{count:,}" for count in counts) + " |" for name, counts in rows.items()]
        return "\n".join(lines) + "\n"

    def save(self, path: Path | str) -> None:
        """Write as JSON."""
        save_record(path, self)

    @staticmethod
    def load(path: Path | str) -> "DatasetTable":
        """Read what `save` wrote.

        Raises:
            InputError: absent, damaged, or a count that is missing, negative or not a whole number.
        """
        return load_record(DatasetTable, path, remake="count the samples of the split again (dataset_table)")


def dataset_table(table: SampleTable, split: Split) -> DatasetTable:
    """Count positions, poses and samples in each part of `split`; the total leaves out what is in no part."""
    keys = np.column_stack([table.position_index, np.round(table.rotation_deg * 1000.0)])
    counts = []
    for part in (*split.parts.values(), np.concatenate(list(split.parts.values()))):
        chosen = keys[np.isin(table.position_index, part)]
        counts.append((len(np.unique(chosen[:, 0])), len(np.unique(chosen, axis=0)), len(chosen)))
    positions, poses, samples = zip(*counts, strict=True)
    return DatasetTable(split.name, positions, poses, samples)
