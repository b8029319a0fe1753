"""Reads the wire protocol's spec and makes from it code, reference and golden vectors.

Standard library only, so that a fresh checkout can regenerate everything.
"""
