"""Samples: the nouns that every part of rattle shares, their log and their signal processing."""
