"""Mesh files: formats, and writing that is all or nothing."""
