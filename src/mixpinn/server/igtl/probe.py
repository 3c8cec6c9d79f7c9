"""What a peer needs to move a probe: its surface, and a place to begin from."""

from mixpinn.base.errors import InputError
from mixpinn.server.igtl.devices import PROBE_MODEL, PROBE_START
from mixpinn.server.igtl.message import Message
from mixpinn.server.igtl.polydata import PolyDataBody
from mixpinn.server.igtl.ras import RasFrame
from mixpinn.server.igtl.transform import TransformBody
from mixpinn.serving.live import LiveSession


def probe_messages(session: LiveSession, frame: RasFrame) -> list[Message]:
    """The probe's surface in its own frame, and the transform of a probe at first touch over the rigid parts.

    Args:
        session: whose first probe it is.
        frame: in which the place is given.
    """
    model = session.predictor.pressing
    probe = model.probes[0].probe
    body = PolyDataBody(probe.points, probe.triangles)
    found = [Message(body.TYPE, PROBE_MODEL, body.pack())]
    mesh = model.hybrid.mesh
    try:
        start = session.skin.place(mesh.points[mesh.part > 0].mean(axis=0), depth=0.0)
    except InputError:  # no skin over the parts that the bundle was prepared for
        return found
    matrix = frame.probe_from_world(start.rotation, start.translation)
    return [*found, Message("TRANSFORM", PROBE_START, TransformBody(matrix).pack())]
