"""A body that is pressed live: poses come in at any rate, answers go out, each naming the pose it belongs to."""

from mixpinn.serving.live.records import Friction, LiveAnswer, LiveProbe, Refusal
from mixpinn.serving.live.session import LiveSession
from mixpinn.serving.live.skin import SkinPlacement
from mixpinn.serving.live.worker import PressWorker

__all__ = ["Friction", "LiveAnswer", "LiveProbe", "LiveSession", "PressWorker", "Refusal", "SkinPlacement"]
