"""Section V12, impact with the sibling: the page, and pairs of stiffness and lumped mass."""
