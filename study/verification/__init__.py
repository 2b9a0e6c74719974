"""Problems whose answer is known, and identities that the paper lacks."""
