"""How each rig is shown: a file each; its entry in RIGS names the class."""
