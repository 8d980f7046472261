"""A CANopen encoder on a bus of its own, behind a socketcand server."""
