"""Scenes out to, and recordings in from, other simulators."""

from mixpinn.interop.sofa_constants import PAPER_SOFA, SofaConstants, SofaContact, SofaTissue
from mixpinn.interop.sofa_export import SofaSettings, export_sofa_scene
from mixpinn.interop.sofa_import import import_sofa, read_sofa_recording, read_sofa_static

__all__ = [
    "PAPER_SOFA", "SofaConstants", "SofaContact", "SofaSettings", "SofaTissue", "export_sofa_scene", "import_sofa",
    "read_sofa_recording", "read_sofa_static",
]
