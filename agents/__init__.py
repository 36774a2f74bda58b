"""Who drives: policies, their evaluation and comparison, and the command line."""
