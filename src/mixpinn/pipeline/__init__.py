"""What runs several stages."""

from mixpinn.pipeline.config import RunConfig
from mixpinn.pipeline.demo import DEMO
from mixpinn.pipeline.onboarding import OnboardingConfig, onboard
from mixpinn.pipeline.run import run_pipeline

__all__ = [
    "DEMO",
    "OnboardingConfig",
    "RunConfig",

    "onboard", "run_pipeline",
]
