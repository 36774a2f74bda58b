"""Planners without a map: they react to what is near, and report when they are stuck."""
