"""Controllers as the field builds them, to compare with; loaded by name, one module each."""
