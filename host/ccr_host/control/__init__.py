"""Controllers behind one small interface (``base``), made by name (``registry``)."""
