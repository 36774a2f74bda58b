"""The shield between any policy and any chair, and the table of reasons for which a chair stops."""

from wheelchair_gym.safety.settings import ShieldSettings
from wheelchair_gym.safety.shield import Decision, Shield

__all__ = ["Decision", "Shield", "ShieldSettings"]
