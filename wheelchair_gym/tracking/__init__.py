"""Tracking: who and what moves around the chair, from the scans of its laser."""

from __future__ import annotations

from wheelchair_gym.tracking.state import DOOR, FURNITURE, KINDS, PERSON, UNKNOWN
from wheelchair_gym.tracking.tracker import Tracker, Tracks

__all__ = [
    "DOOR",
    "FURNITURE",
    "KINDS",
    "PERSON",
    "UNKNOWN",
    "Tracker",
    "Tracks",
]
