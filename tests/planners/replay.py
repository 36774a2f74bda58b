"""The same planner again, for as many iterations as a plan says that it made."""

from dataclasses import fields, replace


def limited_to(planner, iterations, first=None):
    """The planner with other iterations: its own, or its tree's or lattice's where it has none.

    `first` are those of the planner of its first path, where it has one that counts them.
    """
    names = {field.name for field in fields(planner)}
    if first is not None and "tree" in names:
        planner = replace(planner, tree=replace(planner.tree, iterations=first))
    elif first is not None:
        named = {"name": planner.first} if isinstance(planner.first, str) else planner.first
        planner = replace(planner, first={**named, "iterations": first})
    if "iterations" in names:
        return replace(planner, iterations=iterations)
    (part,) = names & {"tree", "lattice"}
    return replace(planner, **{part: replace(getattr(planner, part), iterations=iterations)})
