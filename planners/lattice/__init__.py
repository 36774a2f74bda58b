"""A lattice of maneuvers: A* over x, y and yaw with the exact outline of the chair."""
