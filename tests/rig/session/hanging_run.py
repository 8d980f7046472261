"""A run that drives a motor under a supervisor and then hangs: `python -m ... ADDRESS PATIENCE HOW`."""

from __future__ import annotations

import sys
import time

from drivers.mitsubishi_fr.inverter import FrInverter
from drivers.mitsubishi_fr.settings import InverterSettings
from rig.session.supervisor import Supervisor


def drive_and_hang(address: str, patience_s: float, how: str) -> None:
    """`frozen`: wait to be stopped, beating. `sequence`: beat no more, while the driver polls on."""
    settings = InverterSettings(5.0, 350.0, port=address, unattended_s=600.0)
    inverter, supervisor = FrInverter(settings), Supervisor(None)
    supervisor._silence_s = patience_s  # shorter than a real one's, for a test
    supervisor.launch()
    inverter.open()
    with supervisor:
        inverter.set_speed(200.0)
        supervisor.beat()
        inverter.start()
        supervisor.beat()
        print("driving", flush=True)
        while True:
            if how == "frozen":
                supervisor.beat()
            inverter.check()
            time.sleep(0.02)


if __name__ == "__main__":
    drive_and_hang(sys.argv[1], float(sys.argv[2]), sys.argv[3])
