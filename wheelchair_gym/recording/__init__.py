"""Recordings: MCAP files, live viewers, and replay."""
