"""What a peer sends that cannot be used."""

from mixpinn.base.errors import MixpinnError


class DamagedMessage(MixpinnError):
    """A message that is skipped: the connection goes on with the next one."""


class UnusablePeer(MixpinnError):
    """The stream cannot be followed any further: the connection is closed."""
