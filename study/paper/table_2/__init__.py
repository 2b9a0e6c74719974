"""Table 2 as an inverse problem: models of the beam that the paper may have computed."""
