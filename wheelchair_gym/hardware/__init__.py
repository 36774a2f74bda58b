"""The real chair: its boards' firmware, the bytes they speak, its laser, and the boards' twin."""
