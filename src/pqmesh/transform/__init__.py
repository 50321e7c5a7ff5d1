"""Transformations: of spheres, planes, cones and whole conical or circular meshes."""
