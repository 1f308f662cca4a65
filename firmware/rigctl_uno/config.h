/* Settings of a bench. Limits are compiled in on purpose: no host, and no fault of a host, can raise
 * them. Every value can be given to make: `make EXTRA=-DHOST_TIMEOUT_MS=1000`. */
#ifndef CONFIG_H
#define CONFIG_H

#define FIRMWARE_VERSION "1.1.1"

#ifndef F_CPU
#define F_CPU 16000000UL
#endif
#ifndef BAUD
#define BAUD 115200
#endif

/* Converter counts, 0..1023 for 0..5 V. Defaults are for the transducers of rigs/hl32-bench-uno.yaml. */
#ifndef PRESSURE_TRIP
#define PRESSURE_TRIP 675 /* 70 bar on 0.5..4.5 V = 0..100 bar */
#endif
#ifndef TEMPERATURE_TRIP
#define TEMPERATURE_TRIP 639 /* 95 degC on 0.5..4.5 V = -10..150 degC */
#endif
#ifndef OPEN_LOW
#define OPEN_LOW 16 /* below: a broken wire */
#endif
#ifndef OPEN_HIGH
#define OPEN_HIGH 1007 /* above: a short to the supply */
#endif
#ifndef SENSORS
#define SENSORS 0x07 /* bit 0 pressure, 1 position, 2 oil temperature: monitored for a broken wire */
#endif
#ifndef TRIP_READINGS
#define TRIP_READINGS 8 /* faulty readings, 0.3 ms apart, that trip; a good one cancels a third of one */
#endif

#ifndef HOST_TIMEOUT_MS
#define HOST_TIMEOUT_MS 1500 /* trip if the host is silent for this time while an output is on */
#endif
#ifndef VALVE_REST_MS
#define VALVE_REST_MS 50 /* from any switch of the valve until a solenoid may be energised */
#endif
#ifndef HEATER_REST_MS
#define HEATER_REST_MS 2000 /* from switching the heater off until it may be switched on again */
#endif
#ifndef HEATER_CREDIT_S
#define HEATER_CREDIT_S 7200 /* longest heating from rest; an hour off gives an hour of heating back */
#endif

#endif
