"""Sensors: geometry first, then noise, delay, age and drop-out."""
