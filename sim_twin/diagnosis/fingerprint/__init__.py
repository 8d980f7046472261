"""What a motion without repeats can be known by: distributions of what its cycles show."""
