"""The commands of ``ccr-host``, one module each, combined in ``app``.

Each command imports what it needs when it is called, so that --help and completion stay fast.
"""
