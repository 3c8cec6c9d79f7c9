import numpy as np

from dataset.dataset_fakes import FakeScene, block, filled_store
from mixpinn.dataset import DatasetTable, Split, build_sample_table, dataset_table


def test_counts_of_each_part_and_total(tmp_path):
    table = build_sample_table(filled_store(tmp_path, FakeScene(block(3), trouble={2: "raise"}), positions=5))
    split = Split("by hand", np.array([0, 1]), np.array([3]), np.array([2, 4]))
    counts = dataset_table(table, split)
    # Four samples a pose, two poses a position; position 2 has none.
    assert counts.positions == (2, 1, 1, 4)
    assert counts.poses == (4, 2, 2, 8)
    assert counts.samples == (16, 8, 8, 32)
    counts.save(tmp_path / "table.json")
    assert DatasetTable.load(tmp_path / "table.json") == counts
    assert "| Generated sample | 16 | 8 | 8 | 32 |" in counts.markdown()
