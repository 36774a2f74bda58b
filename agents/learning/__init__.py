"""Learning to drive: settings, what a network is told, training, and what is kept of it."""
