"""Subcommands of `wheelchair`: each module adds its parser and runs."""
