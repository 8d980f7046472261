"""Parts that rigs are made of."""
