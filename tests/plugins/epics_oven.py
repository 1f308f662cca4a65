"""The oven behind an EPICS server (IOC), which is caproto's own."""

from __future__ import annotations

from typing import Any

from caproto import AlarmSeverity, AlarmStatus, ChannelType
from caproto.server import PVGroup, pvproperty, run

from plugins.oven import Oven

OVEN = Oven()


class Ioc(PVGroup):
    temperature = pvproperty(value=20.0, name="TEMPERATURE", read_only=True)
    heater = pvproperty(
        value="Off", name="HEATER", enum_strings=["Off", "On"], record="bi", dtype=ChannelType.ENUM
    )
    fan = pvproperty(value=0.0, name="FAN")
    fan_state = pvproperty(value=0.0, name="FAN_RBV", read_only=True)
    label = pvproperty(value="an oven", name="LABEL", dtype=str)
    broken = pvproperty(value=0, name="BROKEN")  # the thermometer is

    @temperature.scan(period=0.02)
    async def temperature(self, instance: Any, async_lib: Any) -> None:
        invalid = bool(self.broken.value)
        await instance.alarm.write(
            severity=AlarmSeverity.INVALID_ALARM if invalid else AlarmSeverity.NO_ALARM,
            status=AlarmStatus.READ if invalid else AlarmStatus.NO_ALARM,
        )
        await instance.write(OVEN.temperature)

    @heater.putter
    async def heater(self, instance: Any, value: Any) -> None:
        OVEN.set("heater", float(value in (1, "On")))

    @fan.putter
    async def fan(self, instance: Any, value: float) -> None:
        OVEN.set("fan", float(value))
        await self.fan_state.write(OVEN.outputs["fan"])

    @label.startup
    async def label(self, instance: Any, async_lib: Any) -> None:
        await self.heater.write(int(OVEN.outputs["heater"]), verify_value=False)
        OVEN.ready()


if __name__ == "__main__":
    run(Ioc(prefix="OVEN:").pvdb, interfaces=["127.0.0.1"], log_pv_names=False)
