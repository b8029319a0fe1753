"""Controllers from the literature, for comparison; each module is loaded by name."""
