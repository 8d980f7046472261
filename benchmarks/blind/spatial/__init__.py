"""The blind check's spatial slider-crank: two free bodies, held together by a joint's forces."""
