"""What all layers share; imports nothing of ours. `pyproject.toml` reads the version here."""

__version__ = "0.2.0"
