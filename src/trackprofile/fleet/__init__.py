"""Thousands of recordings a night: each read, inferred, assessed and stored, on as many machines as there are."""
