"""The firmware's behaviour in Python, written from protocol/spec.toml and not from the firmware."""
