"""Where ensembles run: worker processes of this machine, or a Dask cluster."""
