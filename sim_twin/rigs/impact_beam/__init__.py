"""The impact beam: a beam on a flexure, driven by a shaker, its tip rattling between two stops in a yoke.

Source: Deck and Dubowsky's impact beam system (IBS), with the parameters of its Tables 1 and 2.
"""
