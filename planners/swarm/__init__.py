"""Swarm optimizers, and the planner whose swarm consists of paths."""
