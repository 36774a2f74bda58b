"""Mapping, SLAM, Monte Carlo localization and frontiers."""
