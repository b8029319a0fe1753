"""The MPC's planner as machine code, by numba (extra ``fast``).

The modules mirror those of the default path, ``control.nlp``, ``control.box_qp`` and
``control.sqp``: same problem, same iterations, same stopping rule. Formulas without loops are
those of the default path themselves, compiled. Nothing here is imported before a robot
description asks for it.
"""
