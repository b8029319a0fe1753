"""Tracking on a static model that is identified before the path and learns along it.

``law`` combines the other modules: ``statics`` and ``motion`` are the model, ``identification``
fits it to rests, ``path_plan`` chooses the branch along the path, ``estimator`` continues to learn.
docs/control-statics.md has the equations.
"""
