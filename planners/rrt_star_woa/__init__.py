"""RRT*-WOA and the control generator of the thesis (Belalia 2023), and our version for poses."""
