"""The physics twin: pure functions of parameters, effects and a random generator."""
