"""From a mesh to its layers: offset vectors, offset meshes, support structure."""
