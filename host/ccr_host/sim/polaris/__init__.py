"""An emulated NDI Polaris: speaks the ASCII protocol, sees the markers of a scene."""
