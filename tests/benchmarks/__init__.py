"""Benchmarks: they print what they measured, with seeds and settings; no test depends on them."""
