"""An emulated NDI Polaris: speaks the ASCII protocol and measures the markers of a scene."""
