"""One file a figure, or a family of figures: what is simulated, what the text says, how it is drawn."""
