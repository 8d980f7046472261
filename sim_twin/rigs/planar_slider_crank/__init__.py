"""The planar slider-crank: constant speed, clearance at both ends of the rod, accelerometers.

Source: Erkaya's planar slider-crank (PSC), 10.1007/s12206-012-0308-8, with the parameters of its Table 1.
"""
