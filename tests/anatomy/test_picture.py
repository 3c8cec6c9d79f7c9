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
