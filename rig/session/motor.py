"""The crank's motor in a run: up to speed, trimmed until the shaft turns as wanted, down again."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeVar

from daq.clock import Clock, SystemClock
from daq.errors import InstrumentRefused, InterlockTripped
from daq.log.records import ClockRecord
from daq.time_base.clocks import CardClock
from drivers.protocols.instrument import Notice
from drivers.protocols.speed_drive import SpeedDrive
from rig.session.interlock import HUNG_S, OVERSPEED_S, Debounced
from rig.session.shaft_speed import RPM_PER_RAD_S
from sim_twin.rigs.crank_drive import SpeedDrive as CrankDrive

_STEP_S, _ORDER_S = 0.02, 3.0
_T = TypeVar("_T")
_OUTPUT_SHARE = 0.01
"""Of the set speed: how near to it an inverter's output counts as there, as its driver sees it too."""
_RAMP_MARGIN, _RAMP_GRACE_S = 1.5, 1.0
ARRIVED_SHARE = 0.10
"""Of the wanted speed: slip and gearing may be off by as much before the loop is closed."""
OVERSPEED, SLOW_AGAIN = 1.5, 1.4
"""Of the wanted speed: what a shaft never goes beyond on a ramp, and below what it no longer runs away."""
_UNLIKE, _ALIKE = 1.25, 1.2
"""Of what the output makes, besides the share above: a shaft that turns faster is geared otherwise than the
bench file says. Less on the way up, for slip, an output that was asked a poll ago and a mean over a turn."""
_SEEN_TURNS, _SEEN_S = 8.0, 2.0
"""A marker shows a speed after four marks that agree; the reading that has them comes a block later."""
_FEWEST_TURNS, _MEAN_S = 3, 1.0
_MOST_TRIMS = 6
_PROOF_SHARE, _PROOF_S = 0.125, 0.5
"""Of the wanted speed, and for how long it has to be seen: two of a card's readings, and their way."""
_PROOF_TURNS = 4.5
"""After so many a marker has shown a speed: four marks, the first of them up to a turn away."""
_BEYOND_ORDER, _FAINT = 1.5, 0.02
"""What motor and gearing may make of an order, and of the wanted speed besides: noise of a tachometer."""
HELD_SHARE = 0.005
"""Of the wanted speed: a mean that stays further off after trimming is told as a warning."""


class MotorActuator:
    """An inverter as an `Actuator`: its safe state is a motor that stands."""

    def __init__(self, drive: SpeedDrive) -> None:
        self._drive = drive
        self.name, self.address = drive.name, drive.address

    @property
    def identity(self) -> str:
        return self._drive.identity

    def open(self) -> None:
        """Connect and check its settings; moves nothing."""
        self._drive.open()

    def close(self) -> None:
        """Stop the motor if it may be turning, and hang up. Never raises."""
        self._drive.close()

    def off(self) -> None:
        self._drive.stop()


class Motor:
    """The `Motion` of a crank at `speed_rad_s`.

    `wait` waits that many seconds and may raise; `measured_rpm` is the speed of the shaft by the instruments
    on it, NaN where they do not show it. Only `start` changes the set value: while a run settles and records,
    it holds still, for every correction would be a disturbance in the record. What `proves` is a motor whose
    speed per volt is known from the bench file alone: it has to show an eighth of the speed before it is told
    to go on; one that no instrument shows has been given the time in which a faster one would have been.
    """

    def __init__(
        self,
        drive: SpeedDrive,
        speed_rad_s: float,
        wait: Callable[[float], None],
        measured_rpm: Callable[[], float],
        clock: Clock | None = None,
        proves: bool = False,
    ) -> None:
        self._drive, self._wait, self._measured_rpm = drive, wait, measured_rpm
        self._proves = proves
        self._clock = clock or SystemClock()
        self.speed_rad_s = speed_rad_s
        self._wanted_rpm = self._fastest_rpm = speed_rad_s * RPM_PER_RAD_S
        self._expect(self._wanted_rpm)
        self._kept_rpm = 0.0
        self._ordered_s = self._busy_s = -math.inf
        self._notices: list[Notice] = []
        self._polls_s: list[tuple[float, float]] = []
        self._new_polls = False

    @property
    def what(self) -> str:
        return f"crank at {self._wanted_rpm:g} rpm, {self._drive.name} set to {self._kept_rpm:g} rpm"

    @property
    def longest_stop_s(self) -> float:
        return self._drive.longest_stop_s

    @property
    def longest_order_s(self) -> float:
        """As long as the driver has been at an order, whose line may be disturbed, and the usual on top."""
        ordered_s = self._ordered_s  # the guard asks, while the sequence sets it
        if ordered_s == -math.inf:
            return HUNG_S
        if self._drive.busy:
            self._busy_s = self._clock.monotonic_s()
        return min(max(self._busy_s - ordered_s, 0.0) + HUNG_S, _ORDER_S)

    def with_drive(self, drive: CrankDrive) -> Motor:
        return Motor(self._drive, drive.speed, self._wait, self._measured_rpm, self._clock, self._proves)

    def arm(self, soft: bool, path: Sequence[CrankDrive] = ()) -> None:
        for warning in self._drive.warnings:
            self._note("warning", "motor.warning", warning)
        first_rpm = path[0].speed * RPM_PER_RAD_S if path else self._wanted_rpm
        first_rpm *= _PROOF_SHARE if self._proves else 1.0
        self._kept_rpm = self._order(lambda: self._drive.arm(first_rpm))

    def start(self, soft: bool, path: Sequence[CrankDrive] = ()) -> None:
        """Come up on the ramp, through the speeds of `path`, and trim until the shaft turns as wanted.

        Raises `InstrumentRefused` where inverter or shaft do not get there, `InterlockTripped` where no
        instrument shows that the shaft turns, or one shows that it runs away: faster than 1.5 times the
        wanted speed for 0.3 s and the time of a turn at the wanted one, or as long 1.25 times what the output
        makes, and a tenth of the wanted speed, before the ramp goes on. Nothing is shown: for 2 s and eight
        turns of the output. Lapses are included: below 1.4 times such as are shorter than 0.15 s, between the
        two or unseen such as are shorter than all that time.
        """
        speeds = [*(drive.speed for drive in path), self.speed_rad_s]
        self._wanted_rpm = self._fastest_rpm = speeds[0] * RPM_PER_RAD_S
        self._order(self._drive.start)
        if self._proves:
            self._prove()
            self._kept_rpm = self._order(lambda: self._drive.set_speed(self._wanted_rpm))
        self._await_output()
        self._await_shaft()
        for speed_rad_s in speeds[1:]:
            self._move_to(speed_rad_s)
        self._trim()

    def go_to(self, speed_rad_s: float) -> None:
        """Go on to another speed as `start` does to the first; raises what that raises."""
        self._move_to(speed_rad_s)
        self._trim()

    def ramp_down(self) -> None:
        self.off()

    def off(self) -> None:
        """Stop in category 1: ramp to zero, seen by the shaft to stand, and run withdrawn."""
        self._drive.stop(self._measured_rpm)

    def cut(self) -> None:
        self._drive.cut()

    def check(self) -> None:
        """Raise what the inverter's driver found; tells it that somebody looks after the motor."""
        self._ordered_s = -math.inf
        self._drive.check()

    def take_notices(self) -> tuple[Notice, ...]:
        own, self._notices = self._notices, []
        both = (*own, *self._drive.take_notices())
        return tuple(sorted(both, key=lambda notice: notice.arrival_s))

    def clocks(self, base: CardClock) -> list[ClockRecord]:
        """When the inverter's answers were taken, by all polls so far; nothing without a new one."""
        if not self._new_polls:
            return []
        self._new_polls = False
        request_s, reply_s = zip(*self._polls_s.copy(), strict=True)  # polls go on
        return [base.polled(self._drive.name, request_s, reply_s)]

    def _order(self, order: Callable[[], _T]) -> _T:
        if self._ordered_s == -math.inf:  # until somebody looks again
            self._ordered_s = self._clock.monotonic_s()
        return order()

    def _prove(self) -> None:
        """Raise InterlockTripped where the shaft is faster than ordered, before it is ordered more.

        Unseen, for as long as one that is too fast may stay so: a slower one is proved by that.
        """
        ordered_rpm = self._kept_rpm
        most_rpm = _BEYOND_ORDER * ordered_rpm + _FAINT * self._wanted_rpm
        self._await_output()
        beyond = Debounced(OVERSPEED_S)
        left_s, seen_s = _PROOF_TURNS * 60.0 / most_rpm + _PROOF_S, 0.0
        while beyond.since_s is not None or (left_s > 0.0 and seen_s < _PROOF_S):
            rpm = self._look_on()
            fast, slow = abs(rpm) > most_rpm, abs(rpm) <= most_rpm  # neither, where nothing is shown
            if beyond.look(self._clock.monotonic_s(), holds=fast, gone=slow) is not None:
                raise InterlockTripped(
                    f"interlock: the shaft turns at {rpm:.4g} rpm where {ordered_rpm:.4g} rpm is ordered: "
                    "what a volt makes in the bench file, the gearing"
                )
            left_s -= _STEP_S
            seen_s += _STEP_S * slow

    def _move_to(self, speed_rad_s: float) -> None:
        before_rpm, self._wanted_rpm = self._wanted_rpm, speed_rad_s * RPM_PER_RAD_S
        self.speed_rad_s = speed_rad_s
        self._fastest_rpm = max(before_rpm, self._wanted_rpm)
        self._expect(min(before_rpm, self._wanted_rpm))
        left_rpm = self._kept_rpm
        self._kept_rpm = self._order(lambda: self._drive.set_speed(self._wanted_rpm))
        self._await_output(left_rpm)
        self._await_shaft()
        self._fastest_rpm = self._wanted_rpm

    def _await_output(self, from_rpm: float = 0.0) -> None:
        """Wait for the ramp; the driver itself raises where the output does not follow."""
        left_s = _RAMP_MARGIN * self._drive.ramp_s(from_rpm, self._kept_rpm) + _RAMP_GRACE_S
        while True:
            state = self._drive.state
            off_rpm = math.inf if state is None else abs(state.speed_rpm - self._kept_rpm)
            if state is not None and state.running and off_rpm <= _OUTPUT_SHARE * self._kept_rpm:
                return
            if left_s < 0.0:
                raise self._refused(
                    f"its output does not come to {self._kept_rpm:g} rpm", "load and its ramp"
                )
            self._follow()
            left_s -= _STEP_S

    def _await_shaft(self) -> None:
        left_s = _SEEN_S + _SEEN_TURNS * 60.0 / self._wanted_rpm
        while not abs(self._measured_rpm() - self._wanted_rpm) <= ARRIVED_SHARE * self._wanted_rpm:
            if left_s < 0.0:
                raise self._not_arrived(self._measured_rpm())
            self._follow()
            left_s -= _STEP_S

    def _expect(self, slowest_rpm: float) -> None:
        """Nothing has been seen yet of a shaft whose turns take as long as at that speed."""
        held_s = OVERSPEED_S + 60.0 / slowest_rpm
        self._too_fast, self._unlike = Debounced(held_s), Debounced(held_s)
        self._blind_s = self._blind_turns = 0.0

    def _follow(self) -> None:
        """Look on, and raise where the shaft is not seen to turn as the output does on its way up."""
        rpm, state = self._look_on(), self._drive.state
        if state is None or self._fastest_rpm > self._wanted_rpm:  # on the way down it may lag behind
            return
        blind = math.isnan(rpm) and state.speed_rpm > 0.0
        self._blind_s = self._blind_s + _STEP_S if blind else 0.0
        self._blind_turns = self._blind_turns + _STEP_S * state.speed_rpm / 60.0 if blind else 0.0
        if self._blind_s > _SEEN_S and self._blind_turns > _SEEN_TURNS:
            raise self._not_arrived(rpm)
        over_rpm = abs(rpm) - ARRIVED_SHARE * self._fastest_rpm
        lasted_s = self._unlike.look(
            self._clock.monotonic_s(),
            holds=over_rpm > _UNLIKE * state.speed_rpm,
            gone=over_rpm < _ALIKE * state.speed_rpm,
        )
        if lasted_s is not None:
            raise InterlockTripped(
                f"interlock: the shaft turns at {rpm:.4g} rpm where the output makes "
                f"{state.speed_rpm:.4g} rpm, for {lasted_s:.1f} s. "
                "Check the gearing (speed per Hz or per V in the bench file), pulses per turn"
            )

    def _look_on(self) -> float:
        """Wait a step and return the measured speed; raises InterlockTripped for a shaft that runs away."""
        self._wait(_STEP_S)
        rpm = self._measured_rpm()
        times = abs(rpm) / self._fastest_rpm
        lasted_s = self._too_fast.look(
            self._clock.monotonic_s(), holds=times > OVERSPEED, gone=times < SLOW_AGAIN
        )
        if lasted_s is not None:
            raise InterlockTripped(
                f"interlock: the shaft turns at {rpm:.4g} rpm where {self._wanted_rpm:g} rpm is wanted, "
                f"for {lasted_s:.1f} s"
            )
        return rpm

    def _not_arrived(self, rpm: float) -> InstrumentRefused | InterlockTripped:
        if math.isnan(rpm):
            return InterlockTripped("interlock: no instrument shows that the shaft turns")
        return self._refused(
            f"the shaft turns at {rpm:.4g} rpm and not at {self._wanted_rpm:g} rpm",
            "the gearing and the poles in the bench file (speed per Hz or per V), belt, and pulses per turn",
        )

    def _trim(self) -> None:
        """Correct the set value by what the mean speed lacks, until that is half a step of it or less."""
        self._settle()
        asked_rpm = self._wanted_rpm
        lacking: dict[float, float] = {}
        for _ in range(_MOST_TRIMS):
            before_s = self._clock.monotonic_s()
            self._order(self._drive.read)  # once, for how long an answer takes
            self._polls_s.append((before_s, self._clock.monotonic_s()))
            self._new_polls = True
            lacking[self._kept_rpm] = found = self._wanted_rpm - self._mean_rpm()
            if abs(found) <= self._drive.step_rpm / 2:
                break
            asked_rpm += found
            self._give(asked_rpm)
            if self._kept_rpm in lacking:
                break
        nearest = min(lacking, key=lambda kept: abs(lacking[kept]))
        if nearest != self._kept_rpm:
            self._give(nearest)
        mean_rpm = self._wanted_rpm - lacking[nearest]
        off = mean_rpm / self._wanted_rpm - 1.0
        text = (
            f"shaft at {mean_rpm:.3f} rpm for {self._wanted_rpm:g} rpm ({off:+.3%}), "
            f"{self._drive.name} set to {self._kept_rpm:g} rpm"
        )
        if abs(off) > HELD_SHARE:
            self._note("warning", "motor.off_speed", text)
        else:
            self._note("info", "motor.trimmed", text)

    def _give(self, rpm: float) -> None:
        """Set the speed; where the inverter keeps another value than before, let that come through."""
        try:
            kept_rpm = self._order(lambda: self._drive.set_speed(rpm))
        except InstrumentRefused as error:
            if error.code != "limit":
                raise
            self._note("warning", "motor.limit", f"no further trimming: {error}")
            return
        if kept_rpm != self._kept_rpm:
            self._kept_rpm = kept_rpm
            self._settle()

    def _settle(self) -> None:
        """Wait for the ramp, and for a whole turn at the new speed."""
        self._await_output()
        for _ in range(math.ceil((_MEAN_S / 2 + 60.0 / self._wanted_rpm) / _STEP_S)):
            self._look_on()

    def _mean_rpm(self) -> float:
        """Mean of the measured speed over whole turns; raises InterlockTripped where it is not known."""
        turn_s = 60.0 / self._wanted_rpm
        count = round(max(_FEWEST_TURNS, math.ceil(_MEAN_S / turn_s)) * turn_s / _STEP_S)
        seen = [rpm for rpm in (self._look_on() for _ in range(count)) if math.isfinite(rpm)]
        if not seen:
            raise self._not_arrived(math.nan)
        return math.fsum(seen) / len(seen)

    def _note(self, level: str, code: str, text: str) -> None:
        self._notices.append(Notice(self._clock.monotonic_s(), level, code, text))

    def _refused(self, what: str, check: str) -> InstrumentRefused:
        return InstrumentRefused(self._drive.name, self._drive.address, what, check)
