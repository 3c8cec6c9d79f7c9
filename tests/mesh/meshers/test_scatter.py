import numpy as np

from mesh.shapes import ball_label_map
from mixpinn.mesh import Grading, extract_surfaces
from mixpinn.mesh.meshers.scatter import scatter, scatter_on_surfaces


def test_points_keep_their_distance_and_leave_no_hole():
    rng = np.random.default_rng(2)
    points = rng.uniform(0.0, 100.0, (4000, 3)) * [1.0, 1.0, 0.0]
    distance = 4.0 + 0.1 * points[:, 0]
    taken = np.array([[50.0, 50.0, 0.0]])
    kept = scatter(points, distance, generator=np.random.default_rng(0), taken=taken)
    chosen, radius = points[kept], distance[kept]
    apart = np.linalg.norm(chosen[:, None] - chosen[None], axis=2) + 1e9 * np.eye(len(chosen))
    assert (apart >= np.minimum(radius[:, None], radius[None])).all()
    assert (np.linalg.norm(chosen - taken, axis=1) >= radius).all()
    standing = np.concatenate([chosen, taken])
    cover = np.linalg.norm(points[:, None] - standing[None], axis=2).min(axis=1)
    assert (cover <= distance).all()


def test_same_seed_same_points():
    points = np.random.default_rng(4).uniform(0.0, 50.0, (1000, 3))
    first, second = (scatter(points, np.full(1000, 5.0), generator=np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_points_lie_closer_where_two_parts_come_close():
    """Balls 4 mm apart: between them the points follow the clearance, away from it the length asked for."""
    surfaces = extract_surfaces(ball_label_map(centres=((-14.0, 0.0, 0.0), (14.0, 0.0, 0.0)), voxel=1.5))
    points = scatter_on_surfaces(surfaces, Grading(rigid=8.0, near=0.8, probed=10.0))
    assert set(points[:, 4]) == {2.0}
    ball = points[np.linalg.norm(points[:, :3] - [14.0, 0.0, 0.0], axis=1) < 14.0][:, :3]
    between, away = ball[ball[:, 0] < 5.0], ball[ball[:, 0] > 14.0]
    def spacing(chosen):
        return np.median([np.sort(np.linalg.norm(ball - p, axis=1))[1] for p in chosen])
    assert spacing(between) < 0.6 * spacing(away)
    assert spacing(away) >= 0.8 * 8.0
