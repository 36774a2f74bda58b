"""What moves in a world besides the chair: people, doors, temporary obstacles and furniture."""
