"""Problems for felupe, an independent finite-element library."""
