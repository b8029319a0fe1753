"""The board emulator, written from protocol/spec.toml independently of the firmware."""
