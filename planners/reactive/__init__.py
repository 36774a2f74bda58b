"""Planners that know no map: what is near leads them, and each says when it is stuck."""
