"""Planners that grow trees: RRT, RRT*, its two whale variants and RRT-Connect."""
