"""Simulated people who drive, and the assistants that help them."""
