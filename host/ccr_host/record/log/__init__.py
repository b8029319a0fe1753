"""The log of a run: MCAP files that Foxglove and PlotJuggler open, written as things happen."""
