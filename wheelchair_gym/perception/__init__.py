"""Mapping, localization and tracking, from what the chair senses."""
