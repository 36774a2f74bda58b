"""Planners that search graphs: grids, roadmaps, cells, Voronoi diagrams, visibility graph."""
