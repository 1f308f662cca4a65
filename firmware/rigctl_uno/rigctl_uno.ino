// rigctl's program for an Arduino Uno (ATmega328P, 16 MHz). Open this folder in the Arduino IDE and upload.
//
// The program is plain C with its own main(), in the files beside this one, so that the same source is built
// with `make` and tested on an emulated board. This file is what the IDE looks for; it adds nothing.
