"""``ccr-host report``: one page of HTML about one or several runs."""
