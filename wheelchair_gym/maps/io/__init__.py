"""Map files: one module for each format."""
