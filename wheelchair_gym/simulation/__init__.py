"""The simulated chair: pymunk lives here and nowhere else."""

from wheelchair_gym.simulation.chair import SimulatedChair
from wheelchair_gym.simulation.settings import ChairSettings, PhysicsSettings

__all__ = ["ChairSettings", "PhysicsSettings", "SimulatedChair"]
