"""What a person sets by hand: a knob, a hand wheel, a variable transformer, an inverter at its panel."""
