"""Curves and shortcuts of paths that were found."""
