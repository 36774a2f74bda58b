"""The twin: both boards' real firmware on emulated chips, in lock step with the simulated world."""
