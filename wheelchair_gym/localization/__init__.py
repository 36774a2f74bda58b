"""Mapping and localisation: what a chair learns of a place, and where in it the chair is."""
