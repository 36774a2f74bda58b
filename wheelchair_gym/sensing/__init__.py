"""Sensing: geometry first, then noise, delay, age and drop-out."""

from wheelchair_gym.sensing.settings import SensorSettings

__all__ = ["SensorSettings"]
