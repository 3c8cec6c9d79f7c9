import math

import pytest

from mixpinn.base.config import build_config
from mixpinn.base.errors import InputError
from mixpinn.mesh.meshers.mesher import Sizing
from mixpinn.mesh.surfaces.extract import SurfaceConfig
from mixpinn.stages.mesh import MeshConfig
from mixpinn.stages.simulation import SimulationConfig


@pytest.mark.parametrize(("kind", "settings", "name"), [
    (SimulationConfig, {"contact": {"friction": math.nan}}, "contact.friction"),
    (SimulationConfig, {"contact": {"friction": -1.0}}, "contact.friction"),
    (SimulationConfig, {"contact": {"stiffness": 0.0}}, "contact.stiffness"),
    (SimulationConfig, {"solver": {"tolerance": -1e-6}}, "solver.tolerance"),
    (SimulationConfig, {"solver": {"max_iterations": 0}}, "solver.max_iterations"),
    (SimulationConfig, {"protocol": {"step": math.inf}}, "protocol.step"),
    (SimulationConfig, {"protocol": {"approach": -1.0}}, "protocol.approach"),
    (SimulationConfig, {"tissue": {"poisson": 0.7}}, "0.7"), (SimulationConfig, {"tissue": {"young": -3.0}}, "-"),
    (MeshConfig, {"size": 0.0}, "mesh.size"), (MeshConfig, {"size": math.nan}, "size"),
    (MeshConfig, {"surface": {"gap": -1.0}}, "surface.gap"), (MeshConfig, {"sizing": {"cell_size": 0.0}}, "cell_size"),
])
def test_settings_without_sense_are_refused_when_they_are_given(kind, settings, name):
    with pytest.raises(InputError) as caught:
        build_config(kind, settings)
    assert name in str(caught.value)


def test_sense_is_checked_without_a_file_too():
    for kind, settings in ((SurfaceConfig, {"gap": math.nan}), (Sizing, {"facet_angle": 0.0})):
        with pytest.raises(InputError):
            kind(**settings)
