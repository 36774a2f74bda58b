"""Whales: how a swarm moves, and swarms of whole paths."""
