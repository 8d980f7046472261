"""Systems that are linear between switches (contact, sticking), integrated exactly from switch to switch."""
