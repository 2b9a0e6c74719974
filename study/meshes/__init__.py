"""Meshes that are used by several sections."""
