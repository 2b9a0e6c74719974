"""Press fits and a dovetail in space (section V22)."""
