"""Define, run, store and compare the study's cases; this package contains no mechanics."""
