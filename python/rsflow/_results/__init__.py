"""Folders of results: whose result stands there, and what is read is not written over."""
