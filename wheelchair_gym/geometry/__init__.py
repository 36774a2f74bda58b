"""Frames, footprints and kinematics."""
