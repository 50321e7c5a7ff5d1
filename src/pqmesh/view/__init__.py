"""Pictures of surfaces, networks, meshes, layers and nodes, as PNG."""
