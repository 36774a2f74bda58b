"""A robotic wheelchair you can simulate, plan for, train for and drive, through one loop."""

__version__ = "0.1.0"
