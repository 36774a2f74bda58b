"""Exact collision tests of points, edges and footprints against polygons."""
