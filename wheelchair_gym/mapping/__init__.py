"""Maps from scans, and where a chair is on a map."""
