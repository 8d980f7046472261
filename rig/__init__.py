"""The bench as its operator knows it: files, runs, live view, report and the `rattle` command."""
