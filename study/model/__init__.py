"""Building blocks of the study's problems: elements, spaces, forms, units and names."""
