"""Many runs over random twins, to measure how robust a controller is to a wrong model.

``plan`` defines the runs, ``random_twin`` draws a twin, ``job`` runs one, ``workers`` runs all of
them on dask.distributed, ``store`` keeps their rows, ``statistics`` summarises them.
"""
