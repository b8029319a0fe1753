"""Many runs over random twins: how good a controller is where its model is wrong.

``plan`` says what is run, ``random_twin`` draws a twin, ``job`` runs one, ``workers`` runs all of
them on dask.distributed, ``store`` keeps their rows, ``statistics`` and ``figure`` sum them up.
"""
