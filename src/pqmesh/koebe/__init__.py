"""Edge offsets: Koebe polyhedra and meshes, what is parallel to them, and how near it comes."""
