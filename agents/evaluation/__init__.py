"""Evaluation: episodes, comparisons, reports, maps and the search for settings."""
