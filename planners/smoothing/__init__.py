"""Curves, shortcuts and refinement of paths that were found."""
