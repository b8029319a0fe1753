"""All that comes to the host from outside during a run, recorded so that it can be played again."""
