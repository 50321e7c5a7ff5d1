"""Abstract meshes and meshes in space, and what they achieve."""
