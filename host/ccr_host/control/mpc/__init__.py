"""The paper's model predictive controller.

One text, which plain Python runs and numba compiles (``control.solver = "compiled"``). So
``problem``, ``sqp`` and ``plan`` keep to what both can do: numbers, tuples, lists of tuples that
stay inside, and arrays. What belongs to one step of the horizon is plain numbers, since array
overhead would be most of the time; only whole matrices are arrays.
"""
