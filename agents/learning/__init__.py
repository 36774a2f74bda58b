"""Learning to drive: settings, observations of networks, training, checkpoints and weights."""
