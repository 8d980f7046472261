"""One time base: the card's sample clock is the master, every other clock has a model against it."""
