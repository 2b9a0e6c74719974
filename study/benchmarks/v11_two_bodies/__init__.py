"""Contact of two deformable bodies whose meshes do not match: section V11."""
