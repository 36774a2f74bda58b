"""Experiments with participants: who drives what with which help in which order, and what came out.

`protocol` is the plan as a file, `session` what one participant does and where it is kept, `report`
compares the conditions.
"""
