"""The two boards: ports, link, protocol, messages and what they say of the chair."""
