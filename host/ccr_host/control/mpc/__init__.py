"""The paper's model predictive controller.

The same source runs as plain Python or is compiled by numba (``control.solver = "compiled"``). So
``problem``, ``sqp`` and ``plan`` are limited to what both support: numbers, tuples, internal lists
of tuples, and arrays. The quantities of a single step of the horizon are plain numbers, since the
overhead of arrays would dominate; only whole matrices are arrays.
"""
