"""Tracking on a static model that is identified before the path and learns along it.

``law`` composes the rest: ``statics`` and ``motion`` are the model, ``identification`` moves the
robot and fits it, ``path_plan`` chooses the branch along the path, ``estimator`` keeps learning.
docs/control-statics.md has the equations.
"""
