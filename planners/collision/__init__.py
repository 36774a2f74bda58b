"""What is free: exact collision tests of points, edges and footprints against polygons."""
