"""The spatial slider-crank: slider on a square guide, universal joint, elastic rod, ball joint, crank.

Source: Deck and Dubowsky's spatial slider-crank (SSC), seed 000 section 4, tables 4 and 5.
"""
