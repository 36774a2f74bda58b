"""Planners that grow trees: RRT, RRT-Connect, RRT* and its variants, values of one loop."""
