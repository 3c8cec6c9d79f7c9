import pyvista as pv

from dataset.dataset_fakes import FakeScene, block, filled_store
from mixpinn.dataset import draw_pose_map, save_pose_map
from mixpinn.dataset.pose_map import pose_colour_key


def test_each_pose_is_drawn_in_the_colour_of_its_state(tmp_path):
    store = filled_store(tmp_path / "store", FakeScene(block(3), trouble={1: "raise", 2: "unconverged"}), positions=4)
    store.discard(store.poses[0])
    keys = [pose_colour_key(store.status(pose)) for pose in store.poses]
    assert keys == ["missing", "done", "failed", "failed", *["done, some steps failed"] * 2, "done", "done"]
    figure = draw_pose_map(store)
    assert [len(panel.lines) for panel in figure.axes] == [4, 4]
    labels = {text.get_text() for text in figure.legends[0].get_texts()}
    assert labels == {"done (3)", "failed (2)", "done, some steps failed (2)", "missing (1)"}


def test_picture_is_written(tmp_path):
    store = filled_store(tmp_path / "store", FakeScene(block(3)))
    save_pose_map(store, tmp_path / "map.png")
    width, height, _ = pv.read(tmp_path / "map.png").dimensions
    assert min(width, height) > 300
