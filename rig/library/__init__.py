"""What `import rattle` gives: logs, predictions, runs and diagnoses for somebody else's Python."""
