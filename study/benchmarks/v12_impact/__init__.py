"""Impact and the symmetric sibling: its page, and pairs of stiffness and lumped mass."""
