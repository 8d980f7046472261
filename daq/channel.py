"""What a row of numbers is: its name, its unit and the sensor behind it."""

from __future__ import annotations

from dataclasses import dataclass

from daq.errors import LogError


@dataclass(frozen=True, slots=True)
class Channel:
    """One measured or predicted quantity.

    `scale` is in `unit` per `raw_unit` (N/V for a force sensor read as a voltage); None where the device
    delivers the unit itself.
    """

    name: str
    unit: str
    quantity: str = ""
    location: str = ""
    sensor: str = ""
    serial: str = ""
    scale: float | None = None
    raw_unit: str = ""

    def metadata(self) -> dict[str, str]:
        """Return the fields that are known, as text, for a log's channel record."""
        texts = {
            "unit": self.unit,
            "quantity": self.quantity,
            "location": self.location,
            "sensor": self.sensor,
            "serial": self.serial,
            "scale": "" if self.scale is None else repr(self.scale),
            "raw_unit": self.raw_unit,
        }
        return {key: text for key, text in texts.items() if text or key == "unit"}

    @classmethod
    def from_metadata(cls, name: str, metadata: dict[str, str]) -> Channel:
        """Rebuild a channel from a log's channel record; unknown keys are ignored. Raises LogError."""
        text = metadata.get("scale")
        try:
            scale = float(text) if text else None
        except ValueError as error:
            raise LogError(f"the scale of {name} is {text!r}") from error
        return cls(
            name=name,
            unit=metadata.get("unit", ""),
            quantity=metadata.get("quantity", ""),
            location=metadata.get("location", ""),
            sensor=metadata.get("sensor", ""),
            serial=metadata.get("serial", ""),
            scale=scale,
            raw_unit=metadata.get("raw_unit", ""),
        )
