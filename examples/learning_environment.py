"""
An environment with Gymnasium's interface
=========================================

For learning agents: ``reset`` and ``step`` as Gymnasium has them, the predictor behind them. What the task is and what
is rewarded is the user's; here a probe shall find and hold a force of 2 N somewhere over the spine. Gymnasium is not
needed: where it is installed, its base class and its spaces are used.
"""

import numpy as np

import mixpinn as mx
from mixpinn.anatomy import tiny_phantom
from mixpinn.fem import DEFAULT_TISSUE
from mixpinn.reduced.equilibrium import Equilibrium
from mixpinn.reduced.hybrid import HybridModel
from mixpinn.reduced.prior import ElasticPrior
from mixpinn.serving import HybridPredictor
from mixpinn.serving.live import SkinPlacement
from mixpinn.stages.hybrid import plain_pose_model

try:
    import gymnasium
except ImportError:
    gymnasium = None

BASE = object if gymnasium is None else gymnasium.Env
DEEPEST = 8.0


class PressToForce(BASE):
    """Action: where to on the back, and how deep, each a change of at most 2 mm. Observation: place, depth, force."""

    metadata = {"render_modes": []}  # noqa: RUF012 (as Gymnasium has it)

    def __init__(self, predictor, wanted=2.0, length=30):
        self.predictor, self.skin, self.wanted, self.length = predictor, SkinPlacement(predictor.pose), wanted, length
        self.above = predictor.mesh.points[:, 1].max()
        if gymnasium is not None:
            self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float32)
            self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (6,), np.float32)

    def reset(self, *, seed=None, options=None):
        """Begin above a random place; returns observation and details."""
        if gymnasium is not None:
            super().reset(seed=seed)
            rng = self.np_random
        else:
            rng = np.random.default_rng(seed)
        self.place, self.count = np.array([*rng.uniform(-8.0, 8.0, 2), -1.0]), 0
        return self.look(), {}

    def step(self, action):
        """One move; returns observation, reward, terminated, truncated, details."""
        self.place = self.place + 2.0 * np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0)
        self.place = np.clip(self.place, [-10.0, -10.0, -2.0], [10.0, 10.0, DEEPEST])
        self.count += 1
        seen = self.look()
        size = float(np.linalg.norm(seen[3:]))
        details = {"trust": self.answer.trust, "motions": self.answer.motions}
        return seen, -abs(size - self.wanted), False, self.count >= self.length, details

    def look(self):
        """Press, and say what is felt."""
        x, z, depth = self.place
        pose = self.skin.place((x, self.above, z), depth=depth)
        self.answer = self.predictor.press(pose.translation, rotation=pose.rotation)
        return np.concatenate([self.place, self.answer.force]).astype(np.float32)


# %%
# The body: the small phantom under a ball, with nothing learned. A fitted bundle comes with ``mx.load(folder)``.

mesh = mx.make_mesh(tiny_phantom(), size=4.0)
prior = ElasticPrior.build(mesh, [DEFAULT_TISSUE])
model = HybridModel.of_prior(prior, Equilibrium.of_materials(mesh, [DEFAULT_TISSUE]))
probe = mx.spherical_probe(radius=15.0, subdivisions=3)
environment = PressToForce(HybridPredictor(model, pose=plain_pose_model(model, probe, mx.ContactConfig())))

# %%
# An agent that needs no learning: press on while the force is too small, draw back where it is too large.


def episode(seed):
    seen, _ = environment.reset(seed=seed)
    rewards, over = [], False
    while not over:
        size = np.linalg.norm(seen[3:])
        seen, reward, _, over, _ = environment.step([0.0, 0.0, np.clip(0.1 * (environment.wanted - size), -1.0, 1.0)])
        rewards.append(reward)
    return seen, np.array(rewards)


# %%
# **Check.** The same seed gives the same episode to the last bit, before contact the reward is that of no force, and
# the agent ends near the force.

first, rewards = episode(seed=3)
again, other = episode(seed=3)
print(f"reward from {rewards[0]:.2f} to {rewards[-1]:.3f}")
assert np.array_equal(first, again)
assert np.array_equal(rewards, other)
assert rewards[-1] > -0.1
