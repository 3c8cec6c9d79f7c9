import numpy as np
from matplotlib import image

from mixpinn.anatomy import draw_label_map, tiny_phantom


def test_picture_shows_every_structure(tmp_path):
    path = tmp_path / "labels.png"
    draw_label_map(tiny_phantom(), path)
    pixels = image.imread(path)[..., :3]
    assert pixels.shape[1] > 1000
    for colour in ((0.93, 0.80, 0.72), (31 / 255, 119 / 255, 180 / 255), (1.0, 127 / 255, 14 / 255)):
        # the legend's patch is some 500 pixels; slices hold far more
        assert (np.abs(pixels - colour).max(axis=-1) < 0.01).sum() > 2000


def test_head_is_up_in_the_view_from_behind(tmp_path):
    path = tmp_path / "labels.png"
    draw_label_map(tiny_phantom(), path)
    pixels = image.imread(path)[..., :3]
    panel = pixels[: int(0.85 * len(pixels)), : pixels.shape[1] // 3]  # without the legend
    upper, lower = (
        np.argwhere(np.abs(panel - colour).max(axis=-1) < 0.01).mean(axis=0)
        for colour in ((31 / 255, 119 / 255, 180 / 255), (1.0, 127 / 255, 14 / 255))
    )
    assert lower[0] - upper[0] > 20.0
    assert abs(lower[1] - upper[1]) < 10.0
