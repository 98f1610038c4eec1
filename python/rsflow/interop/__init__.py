"""Bridges to other libraries and protocols."""
