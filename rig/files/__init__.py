"""The files that an operator writes: scenario, bench, effects; checked as a whole before anything moves."""
