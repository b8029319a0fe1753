"""The link to a board: frames, messages, transports, and the client that keeps it safe."""
