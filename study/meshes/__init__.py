"""Meshes that several sections use."""
