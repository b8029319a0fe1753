"""Tracking on a static model that is identified before the path and learns along it.

``law`` combines modules that are general: ``identification`` fits a ``StaticModel`` to rests,
``estimator`` continues to learn. ``chain_statics`` is that model for any robot; the paper's has its
own, which knows more of printed flexures: ``statics``, ``tip``, ``motion`` and ``path_plan``.
docs/control-statics.md has the equations.
"""
