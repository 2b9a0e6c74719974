"""Press fits, a rolling ball and a dovetail in space (section V22)."""
