"""Real-time, physics-informed simulation of soft tissue with rigid bodies inside.

>>> import mixpinn as mx
>>> labels = mx.load_anatomy("segmentations", repair=True)       # doctest: +SKIP
>>> scene = mx.Scene(mx.make_mesh(labels))                       # doctest: +SKIP
>>> mx.solve_pose(scene, tip=(-10, 121, -15)).force              # doctest: +SKIP

Names are looked up when they are first used, so that this import alone costs next to nothing.
"""

import importlib
from typing import TYPE_CHECKING, Any

from mixpinn.base.compile_cache import settle_compile_cache

if TYPE_CHECKING:
    import mixpinn.dataset.protocol as protocols  # noqa: F401
    from mixpinn.base.errors import InputError as InputError
    from mixpinn.base.errors import MixpinnError as MixpinnError
    from mixpinn.dataset.protocol import Protocol as Protocol
    from mixpinn.dataset.store import SimulationStore as SimulationStore
    from mixpinn.face import fit as fit
    from mixpinn.face import load as load
    from mixpinn.face import load_anatomy as load_anatomy
    from mixpinn.face import make_mesh as make_mesh
    from mixpinn.face import simulate as simulate
    from mixpinn.face import solve_pose as solve_pose
    from mixpinn.fem.contact.model import ContactConfig as ContactConfig
    from mixpinn.fem.material.hyperelastic import LinearElastic as LinearElastic
    from mixpinn.fem.material.hyperelastic import StableNeoHookean as StableNeoHookean
    from mixpinn.fem.material.hyperelastic import StableNeoHookeanLog as StableNeoHookeanLog
    from mixpinn.fem.scene import Scene as Scene
    from mixpinn.fem.solve.quasi_static import SolverConfig as SolverConfig
    from mixpinn.geometry.probe_shapes import linear_probe as linear_probe
    from mixpinn.geometry.probe_shapes import spherical_probe as spherical_probe
    from mixpinn.records.answer import Answer as Answer
    from mixpinn.records.answer import Contact as Contact
    from mixpinn.records.answer import Motion as Motion
    from mixpinn.records.answer import Source as Source
    from mixpinn.records.answer import Trust as Trust
    from mixpinn.records.label_map import LabelMap as LabelMap
    from mixpinn.records.probe import Probe as Probe
    from mixpinn.records.tissue_mesh import TissueMesh as TissueMesh
    from mixpinn.server.client import connect as connect
    from mixpinn.serving.live.session import LiveSession as LiveSession
    from mixpinn.stages.samples import SplitConfig as SplitConfig
    from mixpinn.stages.training import ModelsConfig as ModelsConfig
    from mixpinn.training.config import TrainConfig as TrainConfig

__version__ = "0.1.0"
settle_compile_cache()  # before any kernel is imported

_HOMES = {
    "mixpinn.base.errors": ("InputError", "MixpinnError"),
    "mixpinn.dataset.protocol": ("Protocol", "protocols"),
    "mixpinn.dataset.store": ("SimulationStore",),
    "mixpinn.face": ("fit", "load", "load_anatomy", "make_mesh", "simulate", "solve_pose"),
    "mixpinn.fem.contact.model": ("ContactConfig",),
    "mixpinn.fem.material.hyperelastic": ("LinearElastic", "StableNeoHookean", "StableNeoHookeanLog"),
    "mixpinn.fem.scene": ("Scene",),
    "mixpinn.fem.solve.quasi_static": ("SolverConfig",),
    "mixpinn.geometry.probe_shapes": ("linear_probe", "spherical_probe"),
    "mixpinn.records.answer": ("Answer", "Contact", "Motion", "Source", "Trust"),
    "mixpinn.records.label_map": ("LabelMap",),
    "mixpinn.records.probe": ("Probe",),
    "mixpinn.records.tissue_mesh": ("TissueMesh",),
    "mixpinn.server.client": ("connect",),
    "mixpinn.serving.live.session": ("LiveSession",),
    "mixpinn.stages.samples": ("SplitConfig",),
    "mixpinn.stages.training": ("ModelsConfig",),
    "mixpinn.training.config": ("TrainConfig",),
}
"""Where each public name is defined."""

_HOME = {name: module for module, names in _HOMES.items() for name in names}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'mixpinn' has no attribute {name!r}")
    module = importlib.import_module(_HOME[name])
    found = module if name == "protocols" else getattr(module, name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
