"""The same planner again, for as many iterations as a plan says that it made."""

from dataclasses import fields, replace


def limited_to(planner, iterations):
    """The planner with other iterations: its own, or its tree's or lattice's where it has none."""
    names = {field.name for field in fields(planner)}
    if "iterations" in names:
        return replace(planner, iterations=iterations)
    (part,) = names & {"tree", "lattice"}
    return replace(planner, **{part: replace(getattr(planner, part), iterations=iterations)})
