"""A chair that runs under ROS, driven over rosbridge."""
