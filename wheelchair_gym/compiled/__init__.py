"""Compiled functions: the decorator, arrays by address, and when machine code is made."""
