"""An impact oscillator on a shaken table: a rig from outside rattle, of one mass, one spring and one stop."""
