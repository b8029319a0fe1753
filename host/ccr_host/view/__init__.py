"""Live page: a run in the browser, while it happens and afterwards.

In the run's own process only ``live`` and ``feed`` work; drawing and serving happen in a process of
their own (``page_server``), which may lag or die without the control loop noticing.
"""

DEFAULT_ADDRESS = "127.0.0.1:8642"
