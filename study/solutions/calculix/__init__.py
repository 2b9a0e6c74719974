"""Problems computed by CalculiX: input decks, and stored results to compare with."""
