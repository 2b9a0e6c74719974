"""What the problems of the study are made of: elements, meshes' spaces, forms, units and names."""
