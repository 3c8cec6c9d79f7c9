import pytest

from mixpinn.base.config import build_config
from mixpinn.base.errors import InputError
from mixpinn.base.files import read_json, write_json
from mixpinn.mesh import DomainSurfaces, Surface
from mixpinn.pipeline import DEMO, RunConfig, run_pipeline
from mixpinn.pipeline.run import TIMES, _Clock
from mixpinn.stages.mesh import make_mesh

from .chain import RUN


def test_clock_keeps_the_time_of_the_first_run(tmp_path):
    write_json(tmp_path / TIMES, {"Mesh": 1000.0})
    clock = _Clock(tmp_path / TIMES)
    assert clock.measure("Mesh", lambda: "loaded") == "loaded"
    clock.measure("Simulation", lambda: None)
    seconds = read_json(tmp_path / TIMES)
    assert seconds["Mesh"] == 1000.0
    assert 0.0 <= seconds["Simulation"] < 10.0


def test_first_bad_stage_stops_the_run(tmp_path):
    config = build_config(RunConfig, RUN, {"anatomy": {"source": "folder", "path": str(tmp_path / "absent")}})
    with pytest.raises(InputError, match="absent"):
        run_pipeline(config, out=tmp_path / "out")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["run.json"]


def test_demo_is_a_run_of_the_phantom():
    assert DEMO.anatomy.source == "phantom"
    assert DEMO.simulation.protocol.max_positions == 20
    assert build_config(RunConfig, {"models": {"names": ["physgnn"]}}).models.names == ("physgnn",)


@pytest.mark.parametrize("kind", ["open", "self-intersecting"])
def test_body_surface_that_bounds_no_volume(tmp_path, kind):
    import pyvista as pv

    ball = pv.Icosphere(radius=50.0, nsub=2)
    points, triangles = ball.points.copy(), ball.regular_faces
    if kind == "open":
        triangles = triangles[1:]
    else:
        points[0] *= -1.5  # one corner is pulled through the opposite side
    with pytest.raises(InputError, match=r"closed|intersect") as caught:
        make_mesh(DomainSurfaces(Surface("body", points, triangles), ()), out=tmp_path / "out")
    assert "body" in str(caught.value)
    assert not (tmp_path / "out" / "mesh.vtu").exists()
