"""Benchmarks: how fast environments step here, and how planners fare against each other."""
