"""The simulated chair: pymunk lives here and nowhere else."""
