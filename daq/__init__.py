"""Samples: the nouns that every part of rattle shares, their log and their signal processing."""

from daq.block import Flag, SampleBlock
from daq.channel import Channel
from daq.clock import Clock, SystemClock

__all__ = ["Channel", "Clock", "Flag", "SampleBlock", "SystemClock"]
