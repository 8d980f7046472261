"""What the impact beam stands on: base plate, beam support post, yoke, shaker body and connecting rod, and a cover.

Nothing that the source leaves open was fitted; docs/decisions/0004 has every value and its reason.
"""
