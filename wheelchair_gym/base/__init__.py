"""Errors, files, settings and registries, which import nothing else of ours."""
