"""Which scenario of its world an agent is ready for, and when it has to get ready anew."""

from dataclasses import dataclass


@dataclass
class FlownScenario:
    """The latest one that a world has vouched for.

    A world that takes another scenario and then the first one again has dropped its fleet twice:
    who is ready for the first one, and may never have been told of the other, has to join anew.
    """

    world: str = ''  # instance
    fingerprint: str = ''
    has_changed: bool = False  # the world has said another one meanwhile

    def is_news(self, world: str, fingerprint: str) -> bool:
        """Whether a world is to be asked for what it says, for it may have to be flown."""
        if (world, fingerprint) == (self.world, self.fingerprint):
            return self.has_changed
        self.has_changed = self.has_changed or world == self.world
        return True

    def take(self, world: str, fingerprint: str) -> bool:
        """Fly what a world has vouched for; whether the agent has to get ready for it."""
        is_other = (world, fingerprint) != (self.world, self.fingerprint)
        has_changed, self.has_changed = self.has_changed, False
        self.world, self.fingerprint = world, fingerprint
        return is_other or has_changed
