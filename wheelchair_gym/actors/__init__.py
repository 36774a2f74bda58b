"""Actors that move besides the chair in a world: people, doors, temporary obstacles, furniture."""
