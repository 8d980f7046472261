"""What the impact beam stands on: base plate, support post, yoke, shaker with connecting rod; and a cover.

Nothing that the source leaves open was fitted; docs/decisions/0004 has every value and its reason.
"""
