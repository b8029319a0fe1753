"""Tracking on a static model that is identified before the path and learns along it.

``controller`` composes the rest: ``statics`` is the model, ``excitation`` moves the robot so that
``identification`` can fit it, ``path_plan`` chooses the branch along the path, ``estimator`` keeps
learning. docs/control-statics.md has the equations.
"""
