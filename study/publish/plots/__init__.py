"""What figures share: their look, and kinds of plots."""
