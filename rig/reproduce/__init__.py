"""The papers' figures and tables, computed anew and held against their text."""
