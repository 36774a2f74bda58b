"""The same planner again, for as many iterations as a plan says that it made."""

from dataclasses import fields, replace


def limited_to(planner, iterations):
    """The planner with other iterations: its own, or its tree's where it has none."""
    if "iterations" in {field.name for field in fields(planner)}:
        return replace(planner, iterations=iterations)
    return replace(planner, tree=replace(planner.tree, iterations=iterations))
