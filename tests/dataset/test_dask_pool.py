import pytest

from dataset.dataset_fakes import FakeScene, block, fake_runner, short_store
from mixpinn.base.errors import InputError
from mixpinn.dataset import generate

distributed = pytest.importorskip("distributed")


def test_dask_workers_that_die_lose_no_finished_pose(tmp_path):
    (tmp_path / "log").mkdir()
    scene = FakeScene(block(3), log=tmp_path / "log", trouble={1: "die once"})
    store = short_store(tmp_path / "store", scene)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50,
    ) as cluster:
        summary = generate(scene, store.poses, store, runner=fake_runner, scheduler=cluster.scheduler_address)
    assert (summary.done, summary.failed) == (6, 0)
    runs = scene.runs()
    assert runs.count("pose_001_000") == 2
    assert runs.count("pose_000_000") == 1


def test_threaded_workers_are_refused(tmp_path):
    scene = FakeScene(block(3))
    store = short_store(tmp_path / "store", scene)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=":0", silence_logs=50,
    ) as cluster, pytest.raises(InputError, match="one thread"):
        generate(scene, store.poses, store, runner=fake_runner, scheduler=cluster.scheduler_address)
