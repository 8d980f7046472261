"""The kit that every page is made of: content, template, plots, words."""
