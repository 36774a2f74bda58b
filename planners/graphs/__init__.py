"""Planners that search graphs: A* on a lattice, a lattice of manoeuvres, the visibility graph."""
