"""The laser scanner and the protocol that it speaks."""
