"""The control generator: from a path to commands (v, w, t)."""
