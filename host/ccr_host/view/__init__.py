"""Live page: a run in the browser, while it happens and afterwards.

In the run's own process only ``feed`` and ``buttons`` work; drawing and serving happen in a process
of their own (``page_process``), which may lag or die without the control loop noticing.
"""
