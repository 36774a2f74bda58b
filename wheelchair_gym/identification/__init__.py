"""Identification: the settings of a chair from logs of its drives."""
