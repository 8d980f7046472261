"""What is computed from the samples of a run while it is recorded, and again, to the bit, in a replay.

Speed of a crank, impacts, rms and peak of each cycle; measured and predicted by the same code.
"""
