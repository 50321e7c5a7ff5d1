"""Smooth surfaces: exact jets, curvature, closest points, umbilics."""
