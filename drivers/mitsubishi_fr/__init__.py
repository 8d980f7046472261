"""Mitsubishi FR-D700 and FR-E700 inverters over Modbus RTU on their PU connector."""
