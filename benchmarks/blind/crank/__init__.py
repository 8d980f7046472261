"""The blind check's planar slider-crank: Exudyn's mechanism and contacts, own frame, own sensors."""
