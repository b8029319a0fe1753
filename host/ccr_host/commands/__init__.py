"""The commands of ``ccr-host``, one module each; ``app`` joins them.

Each imports what it needs when it is called, so that --help and completion stay quick.
"""
