"""Reads the wire protocol's spec and makes from it code, reference and golden vectors.

Needs nothing but pydantic and jinja2.
"""
